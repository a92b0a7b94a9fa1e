"""The voltage balance in weak form: which terms the recordings show, and where training begins."""
