"""Scenarios: their keys, the checks on them, and the payloads and plug-ins that they name."""
