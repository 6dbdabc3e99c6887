"""Zenoh sessions, their access rules, and the queues of received messages."""
