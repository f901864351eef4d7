"""What settings cost and what they are worth: limits, errors, times."""
