"""The figures of a report: one module a figure, and the style that all of them have."""
