"""The command as ``python -m penode``, where its script is not on the path."""

from penode_launcher import main

if __name__ == "__main__":
    main()
