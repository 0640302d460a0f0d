//! Named streams of random numbers, all from one seed.
//!
//! A stream is a pure function of `(seed, name, index)`. The key of a ChaCha generator is a hash of seed and name, and the
//! index selects one of its 2^64 independent streams. Open a new stream for each unit of work (an episode, an update) with
//! the number of the unit as the index. Then no generator state has to be stored, because the number restores the stream.

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
