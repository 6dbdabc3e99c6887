"""What a cart is and how it moves: model, filter, learner and control."""
