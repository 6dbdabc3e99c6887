"""Export of identified loads to arms, models and other programs."""
