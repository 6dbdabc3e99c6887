"""The command ``coheft cart``: pushers who find out what cart they push."""
