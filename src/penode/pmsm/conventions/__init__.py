"""Conventions that a drive recording may break, tested against physics."""
