"""Wire: what is sent between processes and read from files, validated where it enters."""
