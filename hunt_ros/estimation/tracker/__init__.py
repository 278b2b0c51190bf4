"""The inner loop of the hunting tracker, in parts that are compiled together."""
