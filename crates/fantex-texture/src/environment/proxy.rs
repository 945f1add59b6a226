//! Reflections of surroundings that are not infinitely far away.
//!
//! A map shows what is seen from its centre. A point beside the centre sees the walls of a room in other directions; if the
//! room is roughly a box or a ball, those follow from where the point's ray meets it (S. Lagarde and A. Zanuttini, "Local
//! image-based lighting with parallax-corrected cubemaps", 2012).

use glam::Vec3;

/// The shape that stands for the surroundings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EnvironmentProxy {
    /// An axis-aligned box.
    Box {
        /// Smallest coordinates.
        min: Vec3,
        /// Largest coordinates.
        max: Vec3,
    },
    /// A ball.
    Ball {
        /// Its centre.
        center: Vec3,
        /// Its radius.
        radius: f32,
    },
}

impl EnvironmentProxy {
    /// The direction in which a map taken at `map_center` shows what a ray from `position` along `direction` meets. Rays
    /// that do not start inside the shape keep their direction. All in one space, of the same units.
    pub fn corrected(&self, position: Vec3, direction: Vec3, map_center: Vec3) -> Vec3 {
        let distance = match *self {
            Self::Box { min, max } => {
                if position.cmplt(min).any() || position.cmpgt(max).any() {
                    return direction;
                }
                // Along each axis to the wall that lies ahead; an axis along which the ray stands still has none.
                let ahead = Vec3::select(direction.cmpgt(Vec3::ZERO), max, min);
                let distances = (ahead - position) / direction;
                let bounded = Vec3::select(direction.cmpeq(Vec3::ZERO), Vec3::INFINITY, distances);
                bounded.min_element()
            }
            Self::Ball { center, radius } => {
                let from_center = position - center;
                let length2 = direction.length_squared();
                let along = from_center.dot(direction);
                let outside = from_center.length_squared() - radius * radius;
                if outside > 0.0 {
                    return direction;
                }
                ((along * along - length2 * outside).sqrt() - along) / length2
            }
        };
        let corrected = position + direction * distance - map_center;
        if corrected.is_finite() && corrected != Vec3::ZERO { corrected } else { direction }
    }

    /// As [`EnvironmentProxy::corrected`], as a unit direction, with its change along a footprint's edges (by differences:
    /// where an edge reaches over a corner of the box, it is the chord).
    pub fn corrected_footprint(
        &self,
        position: Vec3,
        position_steps: [Vec3; 2],
        direction: Vec3,
        direction_steps: [Vec3; 2],
        map_center: Vec3,
    ) -> (Vec3, [Vec3; 2]) {
        let at =
            |position, direction| self.corrected(position, direction, map_center).normalize_or(direction);
        let middle = at(position, direction);
        let steps = [0, 1].map(|i| at(position + position_steps[i], direction + direction_steps[i]) - middle);
        (middle, steps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_are_seen_where_they_are() {
        let walls = EnvironmentProxy::Box { min: Vec3::splat(-1.0), max: Vec3::splat(1.0) };
        let ball = EnvironmentProxy::Ball { center: Vec3::ZERO, radius: 1.0 };
        // From the centre nothing changes.
        let d = Vec3::new(0.3, -0.4, 0.5).normalize();
        for proxy in [walls, ball] {
            assert!(proxy.corrected(Vec3::ZERO, d, Vec3::ZERO).normalize().distance(d) < 1e-6);
        }
        let beside = Vec3::new(0.5, 0.0, 0.0);
        assert_eq!(walls.corrected(beside, Vec3::Z, Vec3::ZERO), Vec3::new(0.5, 0.0, 1.0));
        let met = ball.corrected(beside, Vec3::Z, Vec3::ZERO);
        assert!((met.length() - 1.0).abs() < 1e-6 && met.x == 0.5, "{met}");
        // Outside, and without a direction.
        assert_eq!(walls.corrected(Vec3::X * 2.0, d, Vec3::ZERO), d);
        assert_eq!(ball.corrected(Vec3::X * 2.0, d, Vec3::ZERO), d);
        assert_eq!(walls.corrected(beside, Vec3::ZERO, Vec3::ZERO), Vec3::ZERO);
    }
}
