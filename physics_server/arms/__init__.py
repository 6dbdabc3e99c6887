"""The robots' arms: their shapes, and how they push."""
