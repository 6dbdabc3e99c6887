"""The robots' arms: their mechanics and control."""
