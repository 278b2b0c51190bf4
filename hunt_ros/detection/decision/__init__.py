"""From a row of estimates to state, doubts and level: the kernel of decisions and its parts."""
