"""Bad recordings, bad settings and odd but good files, each given to the real command."""
