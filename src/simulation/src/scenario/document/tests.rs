//! Tests of the text that editing leaves: each against what a person would have written.

use super::*;
use crate::scenario::{Library, Overrides, read_experiment, shipped_scenarios};

const TEXT: &str = r#"# A study of mine.
name = "mine"
duration_s = 20.0 # long enough

[driver.slow]
desired_speed_mps = 0.2

# The one that waits.
[[vehicle]]
name = "first" # of two
route = ["west-street/south/inner/1", "south-boulevard/east/outer/1"] # round the corner
at_m = 0.5 # behind the line
speed_mps = 0.1

# The other one.
[[vehicle]]
route = [
    "south-boulevard/east/outer/1", # its only lane
]
at_m = 1.0

[[vehicle.sensor]]
kind = "camera"
rate_hz = 2

# The end.
[right_of_way]
patience_s = 60.0
"#;

fn edited(edit: impl FnOnce(&mut ScenarioDocument)) -> String {
    let mut document = ScenarioDocument::parse(TEXT).unwrap();
    edit(&mut document);
    let text = document.to_string();
    assert_eq!(ScenarioDocument::parse(&text).unwrap().to_string(), text);
    text
}

#[test]
fn nothing_changes_where_nothing_is_edited() {
    for name in shipped_scenarios() {
        let (text, _) = Library::scenario(name).unwrap();
        let document = ScenarioDocument::parse(&text).unwrap();
        assert_eq!(document.to_string(), text, "{name}");
        let (_, library) = Library::scenario(name).unwrap();
        let experiment = read_experiment(name, &text, &library, Overrides::default()).unwrap();
        for stated in document.vehicles() {
            let vehicle = experiment.planned(stated.id).unwrap();
            assert_eq!(vehicle.name, stated.name);
            assert_eq!(vehicle.leaves, stated.leaves);
        }
    }
}

#[test]
fn what_a_table_states_and_leaves_out_is_told() {
    let document = ScenarioDocument::parse(TEXT).unwrap();
    let [first, second] = <[StatedVehicle; 2]>::try_from(document.vehicles()).unwrap();
    assert_eq!((first.id, first.name.as_str(), first.at_m), (VehicleId(1), "first", 0.5));
    assert_eq!((first.route.len(), first.speed_mps, first.cameras), (2, 0.1, None));
    assert_eq!((second.id, second.name.as_str(), second.speed_mps), (VehicleId(2), "cav2", 0.0));
    assert_eq!(second.cameras, Some(vec!["windscreen".to_owned()]));
    assert_eq!(document.drivers(), ["default", "human", "slow"]);
    assert_eq!(document.default_controller(), "idm", "what the format has where nothing is stated");
    let stated = ScenarioDocument::parse("[driver.default]\ncontroller = \"cacc\"\n").unwrap();
    assert_eq!(stated.default_controller(), "cacc");
    assert_eq!(document.types(), ["default"]);
}

#[test]
fn a_vehicle_is_added_behind_the_others_as_a_person_would_write_it() {
    let text = edited(|document| {
        let vehicle = StatedVehicle {
            name: "third".to_owned(),
            driver: Some("slow".to_owned()),
            route: vec!["west-street/south/inner/1".to_owned()],
            at_m: 0.42,
            leaves: true,
            cameras: Some(vec!["bumper".to_owned()]),
            ..StatedVehicle::default()
        };
        assert_eq!(document.add_vehicle(&vehicle), 2);
    });
    let expected = r#"rate_hz = 2

[[vehicle]]
name = "third"
driver = "slow"
route = ["west-street/south/inner/1"]
at_m = 0.42
leaves = true

[[vehicle.sensor]]
kind = "camera"
mount = "bumper"

# The end.
"#;
    assert_eq!(text, TEXT.replace("rate_hz = 2\n\n# The end.\n", expected));
}

#[test]
fn values_change_in_place_and_comments_stay() {
    let text = edited(|document| {
        for edit in [
            VehicleEdit::Name("renamed".to_owned()),
            VehicleEdit::At(0.75),
            VehicleEdit::Speed(0.0),
            VehicleEdit::Driver(Some("slow".to_owned())),
            VehicleEdit::Route(vec!["west-street/south/inner/1".to_owned(), "a".to_owned(), "b".to_owned()]),
        ] {
            document.edit_vehicle(0, edit);
        }
        document.edit_vehicle(0, VehicleEdit::Driver(None));
        document.edit_vehicle(0, VehicleEdit::Driver(Some("human".to_owned())));
        let longer = ["south-boulevard/east/outer/1", "c"].map(str::to_owned).to_vec();
        document.edit_vehicle(1, VehicleEdit::Route(longer));
        document.edit_vehicle(1, VehicleEdit::Cameras(Some(vec![])));
    });
    let expected = TEXT
        .replace("\"first\" # of two", "\"renamed\" # of two")
        .replace("\"south-boulevard/east/outer/1\"] # round", "\"a\", \"b\"] # round")
        .replace("0.5 # behind", "0.75 # behind")
        .replace("speed_mps = 0.1\n", "speed_mps = 0.0\ndriver = \"human\"\n")
        .replace("# its only lane\n]", "# its only lane\n    \"c\",\n]")
        .replace("\n[[vehicle.sensor]]\nkind = \"camera\"\nrate_hz = 2\n", "sensor = []\n");
    assert_eq!(text, expected);
}

#[test]
fn a_vehicle_has_a_body_and_a_model_of_its_own() {
    let own = edited(|document| {
        document.edit_vehicle(0, VehicleEdit::Shape(Some("van".to_owned())));
        document.edit_vehicle(0, VehicleEdit::Model(Some("bicycle".to_owned())));
    });
    let stated = "speed_mps = 0.1\nshape = \"van\"\nmodel = \"bicycle\"\n";
    assert_eq!(own, TEXT.replace("speed_mps = 0.1\n", stated));
    let mut document = ScenarioDocument::parse(&own).unwrap();
    let vehicle = document.vehicles().remove(0);
    assert_eq!((vehicle.shape.as_deref(), vehicle.model.as_deref()), (Some("van"), Some("bicycle")));
    document.edit_vehicle(0, VehicleEdit::Shape(None));
    document.edit_vehicle(0, VehicleEdit::Model(None));
    assert_eq!(document.to_string(), TEXT);
    // Whatever can be chosen can be run.
    let (text, library) = Library::scenario("roundabout").unwrap();
    let models: Vec<&str> = ScenarioDocument::models().collect();
    for (shape, model) in ScenarioDocument::shapes().zip(models.iter().cycle()) {
        let mut document = ScenarioDocument::parse(&text).unwrap();
        document.edit_vehicle(0, VehicleEdit::Shape(Some(shape.to_owned())));
        document.edit_vehicle(0, VehicleEdit::Model(Some((*model).to_owned())));
        let read = read_experiment("roundabout", &document.to_string(), &library, Overrides::default());
        assert!(read.is_ok(), "{shape} {model}: {}", read.unwrap_err());
    }
}

#[test]
fn a_description_stands_behind_the_name() {
    let text = edited(|document| document.set_description("What it is about"));
    let expected = TEXT.replace("\"mine\"\n", "\"mine\"\ndescription = \"What it is about\"\n");
    assert_eq!(text, expected);
    let mut document = ScenarioDocument::parse(&text).unwrap();
    assert_eq!(document.description(), "What it is about");
    document.set_description("Another one");
    assert_eq!(document.to_string(), expected.replace("What it is about", "Another one"));
    document.set_description("");
    assert_eq!(document.to_string(), TEXT);
}

#[test]
fn a_long_route_has_a_line_for_each_lane() {
    let lanes: Vec<String> = (1..=4).map(|k| format!("some-boulevard/east/outer/{k}")).collect();
    let text = edited(|document| document.edit_vehicle(0, VehicleEdit::Route(lanes.clone())));
    let lines: String = lanes.iter().map(|lane| format!("    \"{lane}\",\n")).collect();
    assert!(text.contains(&format!("route = [\n{lines}] # round the corner\n")), "{text}");
}

#[test]
fn a_removed_vehicle_leaves_the_comments_and_the_other_tables() {
    let text = edited(|document| document.remove_vehicle(0));
    let begin = TEXT.find("[[vehicle]]").unwrap();
    let end = TEXT.find("\n# The other one.").unwrap();
    assert_eq!(text, format!("{}{}", &TEXT[..begin], &TEXT[end..]));
    // The last one, with its sensor, and then there is none.
    let text = edited(|document| {
        document.remove_vehicle(1);
        document.remove_vehicle(7);
        document.remove_vehicle(0);
        assert!(document.vehicles().is_empty());
    });
    for kept in ["# The one that waits.", "# The other one.", "# The end.\n[right_of_way]"] {
        assert!(text.contains(kept), "{text}");
    }
    assert!(!text.contains("vehicle]]") && !text.contains("sensor"), "{text}");
}

#[test]
fn a_file_without_vehicles_gets_its_first_and_inline_ones_are_left_alone() {
    let mut document = ScenarioDocument::parse("name = \"empty\"\nmap = \"ids3c\"\n").unwrap();
    document.add_vehicle(&StatedVehicle { name: "one".to_owned(), ..StatedVehicle::default() });
    let expected =
        "name = \"empty\"\nmap = \"ids3c\"\n\n[[vehicle]]\nname = \"one\"\nroute = []\nat_m = 0.0\n";
    assert_eq!(document.to_string(), expected);
    let inline = "vehicle = [{ route = [\"a\"], at_m = 1 }]";
    assert_eq!(ScenarioDocument::parse(inline).unwrap_err(), EditError::Inline);
    let said = ScenarioDocument::parse("name = ").unwrap_err().to_string();
    assert!(said.contains("not TOML") && said.contains("line 1"), "{said}");
}

#[test]
fn a_driver_is_stated_once_beside_the_others() {
    let text = edited(|document| {
        for _ in 0..2 {
            document.state_driver("parked", "parked");
        }
        document.state_driver("slow", "idm");
    });
    let expected = "desired_speed_mps = 0.2\n\n[driver.parked]\ncontroller = \"parked\"\n";
    assert_eq!(text, TEXT.replace("desired_speed_mps = 0.2\n", expected));
}
