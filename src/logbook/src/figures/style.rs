//! Line styles of vehicles and curves: colours first, dash patterns where there are more vehicles than colours.

use super::chart::{Colour, Dash, LineStyle, PALETTE};

/// Dash patterns, those that are easiest to follow first.
const DASHES: [Dash; 4] = [Dash::Solid, Dash::Dashed, Dash::Dotted, Dash::DashDotted];

/// Styles of which no two are alike.
pub(super) const STYLES: usize = DASHES.len() * PALETTE.len();

/// So many styles, no two of them alike up to 28: all colours with solid lines, then all with the next dash pattern.
pub fn distinct_styles(count: usize) -> impl Iterator<Item = LineStyle> {
    let of = |(dash, colour)| LineStyle { dash, ..LineStyle::solid(colour) };
    DASHES.into_iter().flat_map(|dash| PALETTE.map(|colour| (dash, colour))).map(of).cycle().take(count)
}

/// The styles of the vehicles of a stream, best first. Two streams are told apart by warm and cold colours, several by
/// their dash patterns.
pub(super) fn styles_of_stream(stream: usize, streams: usize) -> impl Iterator<Item = LineStyle> {
    const WARM: [usize; 3] = [0, 2, 4];
    const COLD: [usize; 3] = [1, 3, 5];
    let (own, dashes): (Vec<usize>, Vec<Dash>) = match (streams, stream) {
        (..=1, _) => ((0..PALETTE.len()).collect(), DASHES.to_vec()),
        (2, 0) => (WARM.to_vec(), vec![Dash::Solid, Dash::Dotted]),
        (2, _) => (COLD.to_vec(), vec![Dash::Dashed, Dash::DashDotted]),
        _ => {
            let colours = (0..PALETTE.len()).map(|k| (k + 2 * stream) % PALETTE.len());
            (colours.collect(), (0..DASHES.len()).map(|k| DASHES[(k + stream) % DASHES.len()]).collect())
        }
    };
    let others = (0..PALETTE.len()).filter(|colour| !own.contains(colour)).collect::<Vec<_>>();
    let groups = [own, others].into_iter().flat_map(move |colours| {
        let of = move |dash: Dash| colours.clone().into_iter().map(move |colour| (dash, colour));
        dashes.clone().into_iter().flat_map(of).collect::<Vec<_>>()
    });
    groups.map(|(dash, colour)| LineStyle { dash, ..LineStyle::solid(PALETTE[colour]) })
}

/// Makes lines solid where their colours alone tell them apart.
pub(super) fn plain_where_possible<'s>(styles: impl Iterator<Item = &'s mut LineStyle>) {
    let mut styles: Vec<&mut LineStyle> = styles.collect();
    let mut colours: Vec<Colour> = styles.iter().map(|style| style.colour).collect();
    colours.sort_unstable();
    if colours.windows(2).all(|pair| pair[0] != pair[1]) {
        styles.iter_mut().for_each(|style| style.dash = Dash::Solid);
    }
}

/// A colour as it is under lines that matter more: two thirds of the way to white.
pub(super) fn tint(colour: Colour) -> Colour {
    colour.map(|channel| 255 - (255 - channel) / 3)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(styles: impl Iterator<Item = LineStyle>) -> Vec<(Colour, Dash)> {
        styles.map(|style| (style.colour, style.dash)).collect()
    }

    fn all_differ(keys: &[(Colour, Dash)]) -> bool {
        (1..keys.len()).all(|k| !keys[..k].contains(&keys[k]))
    }

    #[test]
    fn the_first_28_styles_differ_and_the_first_7_are_solid() {
        let styles = keys(distinct_styles(28));
        assert!(styles.len() == 28 && all_differ(&styles));
        assert!(styles[..7].iter().all(|(_, dash)| *dash == Dash::Solid));
    }

    #[test]
    fn vehicles_of_all_streams_have_styles_of_their_own() {
        for streams in 1..=4 {
            for stream in 0..streams {
                let styles = keys(styles_of_stream(stream, streams));
                assert!(styles.len() >= 12 && all_differ(&styles), "{stream} of {streams}");
            }
        }
        let two: Vec<_> = (0..2).flat_map(|stream| keys(styles_of_stream(stream, 2).take(6))).collect();
        assert!(all_differ(&two));
    }

    #[test]
    fn lines_stay_dashed_only_where_a_colour_is_there_twice() {
        let dashed = |colour| LineStyle { dash: Dash::Dashed, ..LineStyle::solid(colour) };
        let mut two = [dashed(PALETTE[0]), dashed(PALETTE[1])];
        plain_where_possible(two.iter_mut());
        assert!(two.iter().all(|style| style.dash == Dash::Solid));
        let mut alike = [dashed(PALETTE[0]), LineStyle::solid(PALETTE[0])];
        plain_where_possible(alike.iter_mut());
        assert_eq!(alike.map(|style| style.dash), [Dash::Dashed, Dash::Solid]);
    }
}
