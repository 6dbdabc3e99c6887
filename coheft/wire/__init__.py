"""Data that crosses process boundaries or is read from files, validated on entry."""
