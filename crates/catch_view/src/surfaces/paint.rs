//! Colours of surfaces: red, green and blue from 0 to 1.

/// A colour.
pub type Colour = [f64; 3];

/// Housings of links.
pub const SHELL: Colour = [0.90, 0.90, 0.89];
/// Rails and fingers.
pub const METAL: Colour = [0.64, 0.65, 0.66];
/// A gripper's housing.
pub const DARK: Colour = [0.24, 0.27, 0.31];
/// Pads on fingers.
pub const RUBBER: Colour = [0.13, 0.14, 0.16];
/// What stands around the arm.
pub const SURROUNDINGS: Colour = [0.70, 0.74, 0.79];
/// A thrown object.
pub const OBJECT: Colour = [0.98, 0.71, 0.10];
/// A thrown ball.
pub const BALL: Colour = [0.80, 0.86, 0.14];
/// A ball's seam, a bottle's cap.
pub const WHITE: Colour = [0.95, 0.95, 0.93];
/// Ends to which an object tapers.
pub const TIP: Colour = [0.42, 0.29, 0.10];

/// A grey of a brightness from 0 to 1.
pub fn grey(brightness: f64) -> Colour {
    [brightness * 0.985, brightness * 0.99, brightness]
}
