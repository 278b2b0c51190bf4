"""One MCAP file: its records as bytes, the way through it, reading, writing, salvage."""
