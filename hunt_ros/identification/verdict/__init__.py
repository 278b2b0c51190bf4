"""What a fit allows to say: tests of the law, guards, numbers with intervals, and the reasons."""
