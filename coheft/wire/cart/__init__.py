"""What crosses process boundaries when agents push a cart: scenarios, configurations and messages."""
