"""The normal form from recordings, with intervals."""
