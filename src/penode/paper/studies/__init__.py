"""The paper's experiments on the simulated bench, and what our defaults do beside them."""
