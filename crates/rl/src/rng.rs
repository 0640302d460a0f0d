//! Named streams of random numbers, all from one seed.
//!
//! A stream is a pure function of `(seed, name, index)`: the name is hashed into the key of a ChaCha generator, the index
//! selects one of its 2^64 independent streams. Take a fresh stream for each unit of work (an episode, an update) with
//! the unit's counter as the index, and no generator state ever has to be stored: whoever knows the counter restores the
//! stream.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sha2::{Digest, Sha256};

/// Opens stream `index` of the family `name`.
///
/// `(seed, name, index) => generator`
pub fn stream(seed: u64, name: &str, index: u64) -> ChaCha8Rng {
    let mut hash = Sha256::new();
    hash.update(seed.to_le_bytes());
    hash.update(name.as_bytes());
    let mut generator = ChaCha8Rng::from_seed(hash.finalize().into());
    generator.set_stream(index);
    generator
}
