//! City and control framework in two processes, as in the laboratory.

use crate::support::link;

use link::{city3d, digests, events, mainframe, serve, summary};

/// Every tick in the log; one scenario after another goes into the same folders.
const EVERY_TICK: [&str; 3] = ["--log-hz", "100", "--force"];

#[test]
fn in_lockstep_two_processes_do_what_one_does_tick_by_tick() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // Delays, jitter and loss are in the control framework's process.
    let text = std::fs::read_to_string(link::root().join("scenarios/roundabout.toml")).unwrap();
    let text = text.replace("profile = \"ideal\"", "profile = \"testbed\"");
    std::fs::write(folder.join("testbed.toml"), text).unwrap();
    for (scenario, duration) in [("roundabout", "40"), ("testbed.toml", "8"), ("city", "3")] {
        let run = [&["run", scenario, "--duration", duration, "--out", "run"], &EVERY_TICK[..]].concat();
        assert!(city3d(&run, folder).output().unwrap().status.success());
        let rest = ["--duration", duration, "--lockstep", "--out", "served"];
        let mut city = serve(&[&[scenario], &rest[..], &EVERY_TICK[..]].concat(), folder);
        let arguments = [&[scenario, "--duration", duration, "--out", "far"], &EVERY_TICK[..]].concat();
        let mut far = mainframe(&city.address, &arguments, folder);
        assert_eq!((far.wait(), city.wait()), (0, 0), "{scenario}");

        let alone = digests(&folder.join("run/run.mcap"));
        assert_eq!(alone.len(), duration.parse::<usize>().unwrap() * 100 + 1);
        for other in ["served", "far"] {
            let digests = digests(&folder.join(other).join("run.mcap"));
            let first = alone.iter().zip(&digests).find(|(a, b)| a != b);
            assert_eq!((first, digests.len()), (None, alone.len()), "{scenario}: {other}");
        }
        let [run, served, far] = ["run", "served", "far"].map(|name| summary(&folder.join(name)));
        assert_eq!(run["state_hash"], served["state_hash"]);
        assert_eq!(events(&run, "merge"), events(&far, "merge"), "{scenario}");
        assert_eq!(served["collisions"], 0);
    }
}
