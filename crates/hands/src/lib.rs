//! eigenhand-hands
