//! Ground truth of random views; `cargo xtask ground-truth` looks at many more.

use city3d_render::{AdapterPreference, Context};
use xtask::ground_truth::City;

/// Views of each city.
const VIEWS: usize = 40;

#[test]
fn every_ray_that_points_down_hits_something_and_presets_agree() {
    let context = match Context::headless(&AdapterPreference::Software) {
        Ok(context) => context,
        Err(error) => {
            assert!(std::env::var_os("CI").is_none(), "pictures cannot be tested: {error}");
            eprintln!("SKIPPED: {error}");
            return;
        }
    };
    for name in ["city", "2x2"] {
        let city = City::read(name).expect("a city");
        let report = city.check(&context, VIEWS, 7).expect("pictures");
        assert!(report.is_right(), "{name}: {report}");
    }
}
