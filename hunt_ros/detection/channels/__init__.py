"""Does a channel measure, do speed and roller agree, and what slow channels say at a row."""
