"""From estimates to region, state and alarm."""
