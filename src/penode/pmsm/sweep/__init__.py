"""Sweeps: many identifications in one campaign, one table, one report."""
