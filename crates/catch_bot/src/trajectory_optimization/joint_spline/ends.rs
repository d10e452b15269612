//! Conditions at the ends of a joint's motion.

/// Ends of a spline that are given, which determine its free control points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ends {
    /// True if the acceleration at the start is given, not only position and velocity.
    pub start_acceleration: bool,
    /// Kind of the condition at the end.
    pub end: EndKind,
}

/// Kind of the condition at the end of a spline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EndKind {
    /// Position and velocity.
    At,
    /// Position; the velocity is free.
    Position,
    /// Velocity and acceleration zero, anywhere.
    Rest,
}

/// Condition at the end of the spline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum End {
    /// Position and velocity are given, acceleration within bounds.
    At {
        /// Position in radians.
        q: f64,
        /// Velocity in rad/s.
        dq: f64,
        /// Lowest and highest acceleration in rad/s², for what comes after.
        ddq: [f64; 2],
        /// Highest speed shortly before, in rad/s.
        last_speed: f64,
    },
    /// The position is given, the velocity is as high as the limits allow in one direction.
    Extreme {
        /// Position in radians.
        q: f64,
        /// 1 for the highest velocity, −1 for the lowest.
        sign: f64,
        /// Highest speed shortly before, in rad/s.
        last_speed: f64,
        /// Continuation after the end.
        onset: Option<Onset>,
    },
    /// The joint ends at rest anywhere, with acceleration zero.
    Rest,
}

/// Condition on the continuation of a motion: q̇ + q̈·`duration_s` must keep within ± `velocity`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Onset {
    /// Duration in seconds.
    pub duration_s: f64,
    /// Largest velocity in rad/s.
    pub velocity: f64,
}

/// Position, velocity and acceleration of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointState {
    /// Position in radians.
    pub q: f64,
    /// Velocity in rad/s.
    pub dq: f64,
    /// Acceleration in rad/s².
    pub ddq: f64,
}
