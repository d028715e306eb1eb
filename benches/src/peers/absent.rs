//! Built without feature `peers`: ours alone.

use super::Library;
use crate::input::Scene;

/// No library.
///
/// # Errors
/// None; the signature is that of the other build.
pub fn load(_scene: &Scene) -> Result<Option<Box<dyn Library>>, String> {
    Ok(None)
}
