"""All messages between the processes of a run: their structs, encoding and size limits."""
