"""What a team holds, from a recording: all samples of all robots in one place (Zhang et al., 2025, and beyond)."""
