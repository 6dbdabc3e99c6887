"""The user's side: starts runs, watches them, reports what came out. The only part that knows all others."""
