"""Recordings: columns in, messages out, repair, import and export."""
