//! Covers that hold more texels than were asked for.

use fantex::cover::{CoverStats, TexelBudget};

use crate::size::{counted, grouped};

/// The number of texels that was asked for, where it was a number of texels.
pub(crate) fn texels_asked(budget: &TexelBudget) -> Option<u64> {
    match budget {
        TexelBudget::Total(texels) => Some(*texels),
        _ => None,
    }
}

/// A sentence on texels beyond those that were asked for. Sides of tiles have at least 4 texels, so many tiles of little surface
/// can take more than the budget.
pub(crate) fn overdraft(asked: Option<u64>, stats: &CoverStats) -> Option<String> {
    let asked = asked.filter(|&asked| stats.texels > asked)?;
    let tiles = counted(stats.groups, "tile");
    Some(format!(
        "{} instead of the {} asked for: {tiles} cannot be smaller, as their sides have at least 4 texels",
        counted(stats.texels, "texel"),
        grouped(asked)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_exceeds_a_number_is_said() {
        let stats = CoverStats { texels: 1600, groups: 100, ..CoverStats::default() };
        assert_eq!(overdraft(texels_asked(&TexelBudget::Total(1600)), &stats), None);
        assert_eq!(overdraft(texels_asked(&TexelBudget::Density(1.0)), &stats), None);
        let text = overdraft(texels_asked(&TexelBudget::Total(1000)), &stats).unwrap();
        assert!(text.starts_with("1 600 texels instead of the 1 000 asked for: 100 tiles"), "{text}");
    }
}
