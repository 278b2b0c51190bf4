"""Where samples come from and set points go: simulated, replayed or real hardware."""
