"""Writers of flux maps for other programs, one format a module: a table in, content out."""
