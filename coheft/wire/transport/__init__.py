"""Zenoh sessions, who may say what on them, and the queues behind them."""
