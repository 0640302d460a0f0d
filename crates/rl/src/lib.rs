//! eigenhand-rl
