//! Options of a displacement, and why there may be none.

use crate::{CREASE_DEGREES, CleanError};

/// Where a mesh is cut finer before it is displaced. Lengths are mesh units, measured before the displacement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refinement {
    /// Until no edge is longer than this (at least [`Refinement::SHORTEST`]).
    Uniform {
        /// Longest edge.
        longest_edge: f32,
    },
    /// Until no edge is longer than `longest_edge`, and along none that is longer than `shortest_edge` the displaced surface
    /// leaves the straight line between the edge's displaced ends by more than `tolerance`.
    Adaptive {
        /// Longest edge: detail that is smaller may be missed.
        longest_edge: f32,
        /// Edges up to this length stay whole; at least [`Refinement::SHORTEST`], not above `longest_edge`.
        shortest_edge: f32,
        /// Positive.
        tolerance: f32,
    },
}

impl Refinement {
    /// The shortest edge that can be asked for, mesh units: single precision must tell its middle from its ends.
    pub const SHORTEST: f32 = 1.0 / (1 << 18) as f32;

    /// The finest length that is asked for.
    pub(super) fn shortest(&self) -> f32 {
        match *self {
            Self::Uniform { longest_edge } => longest_edge,
            Self::Adaptive { shortest_edge, .. } => shortest_edge,
        }
    }

    /// All longer edges are cut.
    pub(super) fn longest(&self) -> f32 {
        match *self {
            Self::Uniform { longest_edge } | Self::Adaptive { longest_edge, .. } => longest_edge,
        }
    }

    /// Largest deviation of the displaced surface from an edge.
    pub(super) fn tolerance(&self) -> f32 {
        match *self {
            Self::Uniform { .. } => f32::INFINITY,
            Self::Adaptive { tolerance, .. } => tolerance,
        }
    }
}

/// How to displace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplaceOptions {
    /// Where the mesh is cut finer.
    pub refinement: Refinement,
    /// Triangles of the result at most.
    pub max_triangles: u64,
    /// Edges of the result that bend less than this are shaded smooth, 0 to 180.
    pub crease_degrees: f32,
}

impl Default for DisplaceOptions {
    /// Edges of 1/128 of the model's largest extent, four million triangles at most.
    fn default() -> Self {
        Self {
            refinement: Refinement::Uniform { longest_edge: 1.0 / 64.0 },
            max_triangles: 4 << 20,
            crease_degrees: CREASE_DEGREES,
        }
    }
}

/// Why a mesh was not displaced.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DisplaceError {
    /// An option is out of its range.
    #[error("{what} is {value}, but must be {allowed}")]
    OutOfRange {
        /// Which of the options.
        what: &'static str,
        /// Its value.
        value: f32,
        /// What is allowed.
        allowed: &'static str,
    },
    /// The refinement asks for too much.
    #[error(
        "cutting edges to {shortest_edge} mesh units takes at least {needed} triangles, but max_triangles is {limit}; \
         choose longer edges"
    )]
    TooManyTriangles {
        /// The finest length that was asked for.
        shortest_edge: f32,
        /// Triangles when cutting stopped.
        needed: u64,
        /// The limit.
        limit: u64,
    },
    /// The height function gave no number.
    #[error("the height on triangle {triangle} is {height}, but must be finite")]
    Height {
        /// Index of the triangle.
        triangle: usize,
        /// What the function gave.
        height: f32,
    },
    /// Nothing is left of the displaced mesh, because everything has collapsed.
    #[error(transparent)]
    Collapsed(#[from] CleanError),
}

impl DisplaceOptions {
    /// Checks every range.
    ///
    /// # Errors
    ///
    /// The first option that is out of range.
    pub fn check(&self) -> Result<(), DisplaceError> {
        let in_range = |what, value: f32, good: bool, allowed| match good {
            true => Ok(()),
            false => Err(DisplaceError::OutOfRange { what, value, allowed }),
        };
        let length = |x: f32| x.is_finite() && x >= Refinement::SHORTEST;
        let longest = self.refinement.longest();
        in_range("longest_edge", longest, length(longest), "a length of at least 2^-18 mesh units")?;
        if let Refinement::Adaptive { shortest_edge, tolerance, .. } = self.refinement {
            let good = length(shortest_edge) && shortest_edge <= longest;
            in_range("shortest_edge", shortest_edge, good, "2^-18 mesh units to longest_edge")?;
            in_range("tolerance", tolerance, tolerance.is_finite() && tolerance > 0.0, "a positive number")?;
        }
        let crease = self.crease_degrees;
        in_range("crease_degrees", crease, (0.0..=180.0).contains(&crease), "0 to 180")
    }
}
