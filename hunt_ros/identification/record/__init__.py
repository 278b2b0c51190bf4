"""What a record consists of: its envelope, its holds and transients, and what is wrong with it."""
