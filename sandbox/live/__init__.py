"""What live front ends share: views that turn, rays through the cursor, pace, and what a panel says. No window here."""
