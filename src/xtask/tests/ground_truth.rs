//! Ground truth of random views; `cargo xtask ground-truth` looks at many more.

#[allow(dead_code, reason = "each test uses its own part")]
#[path = "../../../tests/support/drawing.rs"]
mod drawing;

use xtask::ground_truth::City;

/// Views of each city.
const VIEWS: usize = 40;

#[test]
fn every_ray_that_points_down_hits_something_and_presets_agree() {
    let Some(context) = drawing::software() else { return };
    for name in ["city", "2x2"] {
        let city = City::read(name).expect("a city");
        let report = city.check(&context, VIEWS, 7).expect("pictures");
        assert!(report.is_right(), "{name}: {report}");
    }
}
