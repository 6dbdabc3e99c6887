"""The shell of an agent: its process, its links, and who is at the other end of them."""
