"""Models: what is known, what is learned, and how both lie in one parameter vector."""
