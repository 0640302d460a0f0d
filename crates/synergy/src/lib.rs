//! eigenhand-synergy
