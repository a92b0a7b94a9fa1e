"""Damaged recordings by the thousand: each is read, or refused in one sentence."""
