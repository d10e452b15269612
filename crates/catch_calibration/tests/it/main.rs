//! Refinement of a calibration by flights, on drawn sightings and against a fit by SciPy.

mod flights;
