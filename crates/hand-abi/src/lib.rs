//! eigenhand-hand-abi
