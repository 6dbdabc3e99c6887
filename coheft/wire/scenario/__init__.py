"""Scenarios: their keys and checks, payloads from files, and plugins."""
