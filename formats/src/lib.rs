//! Recordings of event cameras on disk: probe, open, index, slice, write.
