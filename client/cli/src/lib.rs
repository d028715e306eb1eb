//! The lobula tool as a library, so that a wheel can start it too.
