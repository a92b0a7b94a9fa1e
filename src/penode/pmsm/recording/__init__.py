"""Drive recordings: channels, how a file's columns become them, and guesses of both."""
