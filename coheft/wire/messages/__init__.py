"""Every message between the processes of a run: its struct, its bytes, its largest size."""
