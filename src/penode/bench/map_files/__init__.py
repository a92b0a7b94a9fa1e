"""Readers of flux map files, one format a module: a path in, arrays by name out."""
