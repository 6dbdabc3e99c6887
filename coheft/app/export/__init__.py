"""What was found out about a load, for arms, models and other programs."""
