//! eigenhand-sim
