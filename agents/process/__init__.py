"""The shell of an agent: its process and its links."""
