"""The paper's theory: wheelset, linear stability, centre manifold, normal form, simulation."""
