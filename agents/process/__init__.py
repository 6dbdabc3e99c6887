"""The shell of an agent: its process and its network links."""
