//! `city3d bench link` measures what it says.

use crate::support::drawing;

use serde_json::Value;
use std::process::Command;

fn p50(report: &Value, what: &str) -> f64 {
    let spread = &report[what];
    let [p50, p99, most] = ["p50_us", "p99_us", "most_us"].map(|key| spread[key].as_f64().unwrap());
    assert!(p50 <= p99 && p99 <= most, "{what}: {spread}");
    p50
}

#[test]
fn the_link_bench_prints_a_line_without_cameras_and_one_with() {
    if drawing::software().is_none() {
        return;
    }
    let output = Command::new(env!("CARGO_BIN_EXE_city3d"))
        .args(["bench", "link", "--vehicles", "8", "--cameras", "2", "--seconds", "1"])
        .args(["--width", "64", "--height", "48", "--adapter", "software"])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let told = String::from_utf8(output.stdout).unwrap();
    let reports: Vec<Value> = told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(reports.iter().map(|report| &report["cameras"]).collect::<Vec<_>>(), [0, 2]);
    for report in &reports {
        assert_eq!((&report["bench"], &report["vehicles"]), (&"city3d_link".into(), &8.into()));
        assert!(report["datagrams"].as_u64().unwrap() > 50, "of a hundred ticks: {report}");
        // The parts are spans of one journey that nothing can make in no time.
        for part in ["inward", "outward", "step", "python_echo"] {
            assert!((0.5..1e6).contains(&p50(report, part)), "{part}: {report}");
        }
        assert!(p50(report, "beyond_tick") >= p50(report, "outward").max(p50(report, "inward")), "{report}");
    }
    let pictures = reports[1]["images"].as_u64().unwrap();
    assert!(reports[0]["images"] == 0 && pictures >= 4, "{pictures} pictures of two cameras");
}
