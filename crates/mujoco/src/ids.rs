//! Typed indices into a model, resolved by name once, at construction.

macro_rules! typed_id {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub struct $name(pub(crate) usize);

        impl $name {
            /// Returns the position in the model's arrays.
            pub fn index(self) -> usize {
                self.0
            }
        }
    };
}

typed_id!(
    /// A body of a [`Model`](crate::Model).
    BodyId
);
typed_id!(
    /// A joint of a [`Model`](crate::Model).
    JointId
);
typed_id!(
    /// A geom of a [`Model`](crate::Model).
    GeomId
);
typed_id!(
    /// A site of a [`Model`](crate::Model).
    SiteId
);
typed_id!(
    /// An actuator of a [`Model`](crate::Model).
    ActuatorId
);
