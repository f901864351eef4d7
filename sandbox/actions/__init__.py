"""What is done to bodies while a scene runs: who is meant, what is due, and the forces of hands."""
