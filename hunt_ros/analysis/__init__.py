"""Analysis of whole records: spectrum, phase portrait, Poincare section."""
