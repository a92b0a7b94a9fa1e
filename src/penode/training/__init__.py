"""Training: one objective, its optimisers, and the uncertainty of what they find."""
