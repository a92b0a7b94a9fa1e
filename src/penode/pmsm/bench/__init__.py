"""The simulated bench: a machine whose truth is known, driven and recorded like a real one."""
