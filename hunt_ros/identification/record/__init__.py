"""What a record consists of: its envelope, events and steady states, and what is wrong with it."""
