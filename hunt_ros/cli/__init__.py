"""The command line: one verb per file, each importing its work when it runs."""
