//! eigenhand-train
