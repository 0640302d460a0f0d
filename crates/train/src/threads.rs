//! The threads that share the work of an update.

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::TrainError;

/// Starts the threads that share the work of an update.
///
/// # Errors
/// [`TrainError::Thread`].
pub fn learning_threads(count: usize) -> Result<ThreadPool, TrainError> {
    let name = |number| format!("learning-{number}");
    let pool = ThreadPoolBuilder::new().num_threads(count).thread_name(name).build();
    pool.map_err(|error| TrainError::Thread { source: std::io::Error::other(error) })
}
