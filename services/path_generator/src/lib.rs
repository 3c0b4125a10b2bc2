//! path_generator
