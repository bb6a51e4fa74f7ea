//! Overlays of the city: the outline of the selection, labels, paths, gaps, colours, and the legend.

#![allow(clippy::disallowed_methods, reason = "looks at what is drawn; no state depends on it")]

use super::city::{click_at, has_text, picture, place, spread, texts, vehicle_at};
use super::desk::{Desk, EditedFile, click, harness, press};
use city3d_protocol::snapshot::{ControlDecision, Status, VehicleId};
use city3d_roadmap::LaneId;
use city3d_sensors::{Lens, Mount};
use city3d_session::ControlInsight;
use city3d_viewer::ui::{ColourBy, PictureSlot, ScenarioCamera};
use egui::{Rect, Shape};
use egui_kittest::Harness;
use glam::{DVec2, DVec3, Vec3};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Places of the texts that are painted.
fn text_rect(harness: &Harness<'static, Desk>, text: &str) -> Option<Rect> {
    fn of(shape: &Shape, text: &str) -> Option<Rect> {
        match shape {
            Shape::Text(painted) if painted.galley.text() == text => Some(painted.visual_bounding_rect()),
            Shape::Vec(shapes) => shapes.iter().find_map(|shape| of(shape, text)),
            _ => None,
        }
    }
    harness.output().shapes.iter().find_map(|clipped| of(&clipped.shape, text))
}

/// How many lines of the overlay lie within some metres of a vehicle.
fn lines_near(harness: &Harness<'static, Desk>, index: usize, within_m: f32) -> usize {
    let at = harness.state().run_state.now.vehicles[index].position.as_vec3();
    let is_near = |point: &Vec3| point.distance(at) < within_m;
    harness.state().state.overlay.lines.iter().filter(|line| line.ends.iter().all(is_near)).count()
}

#[test]
fn the_selected_vehicle_has_an_outline_that_shows_through_walls_and_others_have_none() {
    let mut harness = harness(Desk::with(spread(3)));
    assert!(harness.state().state.overlay.is_empty());
    harness.state_mut().state.selection.vehicle = Some(VehicleId(2));
    harness.run_steps(2);
    assert_eq!([0, 1, 2].map(|index| lines_near(&harness, index, 5.0)), [0, 12, 0], "the edges of its box");
    let overlay = &harness.state().state.overlay;
    assert!(overlay.triangles.len() >= 8, "a ring on the ground");
    assert!(overlay.triangles.iter().all(|ring| ring.paint.behind > 0.0 && ring.paint.behind < 1.0));
}

#[test]
fn a_label_stands_above_its_vehicle_and_nothing_crosses_the_windscreen() {
    let mut desk = Desk::with(spread(3));
    desk.state.selection.vehicle = Some(VehicleId(2));
    let mut harness = harness(desk);
    for key in [egui::Key::Num1, egui::Key::Num4] {
        press(&mut harness, key);
        let label = text_rect(&harness, "2 car2").expect("it has a label");
        let view = super::city::picture(&harness, city3d_viewer::ui::PictureSlot::City).view;
        let vehicle = &harness.state().run_state.now.vehicles[1];
        let corners = [[-2.5, -1.25], [2.5, -1.25], [2.5, 1.25], [-2.5, 1.25]];
        let tops = corners.iter().flat_map(|[x, y]| [0.0, 1.5].map(|z| DVec3::new(*x, *y, z)));
        let [_, height] = view.extent.map(|pixels| pixels as f32);
        let top = tops
            .map(|corner| view.project(vehicle.position + corner).unwrap().y as f32)
            .fold(f32::INFINITY, f32::min);
        let rect = place(&harness);
        let top = rect.top() + top / height * rect.height();
        assert!(
            label.bottom() <= top,
            "{key:?}: the label ends at {}, the car begins at {top}",
            label.bottom()
        );
    }
    // No line of the panels runs from the label to the car.
    let car = vehicle_at(&harness, 1);
    let crosses = harness.output().shapes.iter().any(|clipped| match &clipped.shape {
        Shape::LineSegment { points, .. } => points.iter().any(|point| point.distance(car) < 6.0),
        _ => false,
    });
    assert!(!crosses);
}

/// What is painted in a place without text: shapes that are closed or filled, by their kind.
fn signs_in(harness: &Harness<'static, Desk>, place: Rect) -> Vec<&'static str> {
    let sign = |shape: &Shape| match shape {
        Shape::Circle(circle) if circle.fill == egui::Color32::TRANSPARENT => Some("ring"),
        Shape::Circle(_) => Some("disc"),
        Shape::Rect(_) => Some("square"),
        Shape::LineSegment { .. } => Some("line"),
        Shape::Path(path) if path.closed => match path.points.len() {
            3 => Some("triangle"),
            4 => Some("diamond"),
            _ => Some("polygon"),
        },
        _ => None,
    };
    let is_inside = |shape: &Shape| place.contains_rect(shape.visual_bounding_rect());
    let shapes = harness.output().shapes.iter().map(|clipped| &clipped.shape);
    shapes.filter(|shape| is_inside(shape)).filter_map(sign).collect()
}

#[test]
fn labels_and_the_map_tell_statuses_by_signs_and_not_by_colours_alone() {
    let mut harness = harness(Desk::with(spread(1)));
    let mut on_labels = BTreeSet::new();
    let mut on_maps = BTreeSet::new();
    let urgent = [Status::Driving, Status::Yielding, Status::Stopped, Status::Manual, Status::Collided];
    for status in urgent {
        harness.state_mut().change(|now| now.vehicles[0].status = status);
        harness.run_steps(2);
        let text = text_rect(&harness, "1 car1").expect("it has a label");
        let beside = Rect::from_min_max(text.left_top() - egui::vec2(16.0, 4.0), text.left_bottom());
        on_labels.insert(signs_in(&harness, beside.expand(1.0)));
        let map = Rect::from_min_size(
            place(&harness).right_top() + egui::vec2(-158.0, 8.0),
            egui::Vec2::splat(150.0),
        );
        on_maps.insert(signs_in(&harness, map.shrink(1.0)));
    }
    assert_eq!(on_labels.len(), urgent.len(), "at labels: {on_labels:?}");
    assert_eq!(on_maps.len(), urgent.len(), "on the map: {on_maps:?}");
}

#[test]
fn the_route_of_the_selected_vehicle_is_told_from_those_of_the_others() {
    let mut desk = Desk::with(spread(3));
    let lanes: Vec<LaneId> = desk.map.lanes.iter().take(2).map(|lane| lane.id).collect();
    desk.routes = (1..=3).map(|id| (VehicleId(id), lanes.clone())).collect();
    desk.state.layers.all_routes = true;
    let mut harness = harness(desk);
    let widths = |harness: &Harness<'static, Desk>| {
        let lines = &harness.state().state.overlay.lines;
        let widest = lines.iter().map(|line| line.width).fold(0.0, f32::max);
        (lines.iter().filter(|line| line.width < 2.0).count(), widest)
    };
    let (all, widest) = widths(&harness);
    assert!(all > 0 && widest < 2.0, "of all, none stands out");
    // Beside one another: at the same place along the lane each has a line of its own.
    let first: Vec<Vec3> = harness.state().state.overlay.lines.iter().map(|line| line.ends[0]).collect();
    let mut distinct: Vec<Vec3> = Vec::new();
    for point in first.iter().filter(|point| first[0].distance(**point) < 1.0) {
        if distinct.iter().all(|other| other.distance(*point) > 0.3) {
            distinct.push(*point);
        }
    }
    assert_eq!(distinct.len(), 3, "{distinct:?}");
    harness.state_mut().state.selection.vehicle = Some(VehicleId(2));
    harness.run_steps(2);
    let (others, widest) = widths(&harness);
    assert!(others < all && widest >= 4.0, "the selected one is wide");
    assert!(has_text(&harness, "route of vehicle 2"), "{:?}", texts(&harness));
    harness.state_mut().state.layers.legend = false;
    harness.run_steps(2);
    assert!(!has_text(&harness, "route of vehicle 2"));
}

#[test]
fn where_many_routes_share_a_lane_one_line_tells_how_many() {
    let lines = |count: u32| {
        let mut desk = Desk::with(spread(count));
        let lane = desk.map.lanes[0].id;
        desk.routes = (1..=count).map(|id| (VehicleId(id), vec![lane])).collect();
        desk.state.layers.all_routes = true;
        let harness = harness(desk);
        let is_told = has_text(&harness, "more than 7 routes: the wider, the more");
        assert_eq!(is_told, count > 7, "the legend tells what is drawn");
        let lines = &harness.state().state.overlay.lines;
        let colours: BTreeSet<[u8; 4]> = lines.iter().map(|line| line.paint.colour).collect();
        (lines.len(), colours.len(), lines[0].width)
    };
    let (alone, few, many, most) = (lines(1), lines(7), lines(8), lines(30));
    assert_eq!(few.0, 7 * alone.0, "a few lie beside one another");
    assert_eq!((many.0, many.1), (alone.0, 1), "many are one line, which hides none of them");
    assert!(alone.2 == few.2 && few.2 < many.2 && many.2 < most.2, "{alone:?} {few:?} {many:?} {most:?}");
}

/// Two cars on a lane, one behind the other, so many metres from bumper to bumper.
fn following(gap_m: f64) -> Desk {
    let mut desk = Desk::with(spread(2));
    let lane = desk.map.lanes.iter().max_by(|a, b| a.curve.length().total_cmp(&b.curve.length())).unwrap();
    let (id, curve) = (lane.id, lane.curve.clone());
    desk.routes = (1..=2).map(|vehicle| (VehicleId(vehicle), vec![id])).collect();
    desk.change(|now| {
        for (vehicle, at_m) in now.vehicles.iter_mut().zip([10.0, 15.0 + gap_m]) {
            let pose = curve.at(at_m).pose;
            vehicle.position = pose.position.extend(0.0);
            vehicle.orientation = glam::DQuat::from_axis_angle(DVec3::Z, pose.yaw_rad);
            (vehicle.speed_mps, vehicle.status) = (8.0, Status::Driving);
        }
    });
    desk
}

#[test]
fn the_legend_tells_the_driven_path_of_the_selected_vehicle_from_those_of_the_others() {
    let mut desk = following(12.0);
    desk.state.layers.tracks = true;
    let mut harness = harness(desk);
    assert!(has_text(&harness, "driven paths, the last 20 s, in their colours"), "{:?}", texts(&harness));
    harness.state_mut().state.selection.vehicle = Some(VehicleId(1));
    harness.run_steps(3);
    assert!(has_text(&harness, "driven path of vehicle 1, the last 20 s"), "{:?}", texts(&harness));
    assert!(has_text(&harness, "driven paths of the others, the last 20 s, in their colours"));
}

#[test]
fn gaps_are_written_in_metres_and_seconds() {
    for (gap_m, text) in [(12.0, "12.0 m, 1.5 s"), (4.0, "4.0 m, 0.5 s")] {
        let mut desk = following(gap_m);
        desk.state.layers.gaps = true;
        desk.state.selection.follow = Some(VehicleId(1));
        let mut harness = harness(desk);
        harness.run_steps(30);
        assert!(has_text(&harness, text), "{text} in {:?}", texts(&harness));
        assert!(has_text(&harness, "gap of less than 1 s"), "the legend tells the colours");
        assert_eq!(harness.state().state.overlay.lines.len(), 1);
        assert!(has_text(&harness, "gap to the vehicle ahead"), "of all");
        harness.state_mut().state.selection.vehicle = Some(VehicleId(1));
        harness.run_steps(3);
        assert!(has_text(&harness, "gap of the selected vehicle to the one ahead"));
    }
}

#[test]
fn paths_boxes_frusta_and_measured_poses_have_layers() {
    let mut desk = following(20.0);
    let camera = ScenarioCamera { name: "front".into(), mount: Mount::Bumper, lens: Lens::default() };
    desk.cameras = BTreeMap::from([(VehicleId(1), vec![camera])]);
    let measured = |id: u32, left_m: f64| {
        let vehicle = desk.run_state.now.vehicle(VehicleId(id)).unwrap();
        let pose = vehicle.pose();
        let measured = city3d_geometry_pose(pose.point_at(0.0, left_m), pose.yaw_rad);
        ControlDecision { vehicle: VehicleId(id), measured: Some(measured), ..ControlDecision::default() }
    };
    let decisions = Some(vec![measured(1, 0.3), measured(2, 0.3)]);
    desk.run_state.insight = Some(Arc::new(ControlInsight { decisions, ..ControlInsight::default() }));
    let mut harness = harness(desk);
    let lines = |harness: &Harness<'static, Desk>| harness.state().state.overlay.lines.len();
    let switch = |harness: &mut Harness<'static, Desk>, set: fn(&mut city3d_viewer::ui::Layers, bool)| {
        set(&mut harness.state_mut().state.layers, true);
        harness.run_steps(2);
        let count = lines(harness);
        set(&mut harness.state_mut().state.layers, false);
        harness.run_steps(2);
        assert_eq!(lines(harness), 0);
        count
    };
    assert_eq!(switch(&mut harness, |layers, on| layers.boxes = on), 24);
    assert_eq!(switch(&mut harness, |layers, on| layers.frusta = on), 8);
    assert_eq!(switch(&mut harness, |layers, on| layers.measured = on), 10, "outlines, and ways to them");
    // At 8 m/s six seconds are 48 m.
    assert!(switch(&mut harness, |layers, on| layers.path = on) > 40);
    for step in 1..=20 {
        harness.state_mut().change(|now| {
            now.time_s += 0.5;
            now.vehicles[0].position.x += f64::from(step) * 0.1;
        });
        harness.run_steps(1);
    }
    assert!(switch(&mut harness, |layers, on| layers.tracks = on) >= 15);
    harness.state_mut().edit = Some(EditedFile::of_fleet(3));
    assert_eq!(switch(&mut harness, |layers, on| layers.tracks = on), 0, "what is edited has not driven");
    harness.state_mut().edit = None;
}

fn city3d_geometry_pose(position: DVec2, yaw_rad: f64) -> city3d_geometry::Pose2 {
    city3d_geometry::Pose2::at(position, yaw_rad)
}

#[test]
fn vehicles_are_coloured_by_status_speed_or_waiting_time_and_the_legend_says_so() {
    let mut desk = following(20.0);
    desk.state.layers.boxes = true;
    desk.change(|now| {
        now.vehicles[0].speed_mps = 0.0;
        now.vehicles[1].speed_mps = 20.0;
    });
    let mut harness = harness(desk);
    let colours = |harness: &Harness<'static, Desk>| {
        let lines = &harness.state().state.overlay.lines;
        [lines[0].paint.colour, lines[12].paint.colour]
    };
    assert_eq!(colours(&harness)[0], colours(&harness)[1], "both are driving");
    assert!(harness.state().state.tints.is_empty(), "bodies have their own colours");
    harness.state_mut().state.layers.colour = ColourBy::Speed;
    harness.run_steps(2);
    let [slow, fast] = colours(&harness);
    assert!(slow != fast && fast[0] > 240, "{slow:?} {fast:?}");
    let tints: Vec<[u8; 3]> = harness.state().state.tints.iter().map(|(_, colour)| *colour).collect();
    assert_eq!(tints[..2], [&slow[..3], &fast[..3]], "bodies have the colours of their boxes");
    assert!(has_text(&harness, "speed: 0 to 50 km/h or more"), "{:?}", texts(&harness));
    harness.state_mut().state.layers.colour = ColourBy::Waiting;
    for _ in 0..30 {
        harness.state_mut().change(|now| now.time_s += 1.0);
        harness.run_steps(1);
    }
    let [stands, drives] = colours(&harness);
    assert!(stands != drives, "it has been standing for half a minute");
    assert!(has_text(&harness, "waiting time: 0 to 60 s or more"));
}

#[test]
fn the_legend_folds_to_its_title_and_by_itself_covers_no_more_than_half_of_a_small_view() {
    let mut desk = following(20.0);
    desk.state.layers.boxes = true;
    desk.state.layers.zones = true;
    let mut harness = harness(desk);
    assert!(has_text(&harness, "collided") && has_text(&harness, "conflict zone: merge"));
    click(&mut harness, "\u{23f7} Legend");
    assert!(!has_text(&harness, "conflict zone: merge"));
    click(&mut harness, "\u{23f5} Legend (7)");
    assert!(has_text(&harness, "conflict zone: merge"));
    harness.state_mut().state.layers.is_legend_open = None;
    harness.set_size(egui::vec2(640.0, 400.0));
    harness.run_steps(4);
    assert!(!has_text(&harness, "conflict zone: merge"), "there is no room");
    click(&mut harness, "\u{23f5} Legend (7)");
    assert!(has_text(&harness, "conflict zone: merge"), "unless one wants it");
}

#[test]
fn the_other_views_show_the_layers_too() {
    let mut desk = following(12.0);
    desk.state.layers.gaps = true;
    desk.state.open.views[0] = true;
    let mut harness = harness(desk);
    harness.run_steps(4);
    let state = &harness.state().state;
    assert_eq!(state.views.overlays[0].lines.len(), state.overlay.lines.len());
    assert!(!state.overlay.lines.is_empty());
    let labels = texts(&harness).into_iter().filter(|text| text == "1 car1").count();
    assert_eq!(labels, 2, "a label in each view");
}

#[test]
fn a_label_stands_for_its_vehicle_whatever_is_behind_it() {
    let mut harness = harness(Desk::with(spread(2)));
    let label = text_rect(&harness, "1 car1").expect("it has a label");
    // The other car is put behind the label, where a click would have found it.
    let (view, rect) = (picture(&harness, PictureSlot::City).view, place(&harness));
    let share = (label.center() - rect.min) / rect.size();
    let clip = DVec3::new(f64::from(share.x) * 2.0 - 1.0, 1.0 - f64::from(share.y) * 2.0, 0.5);
    let eye = view.extrinsics.position;
    let ray = view.clip_from_world().inverse().project_point3(clip) - eye;
    let ground = eye + ray * (-eye.z / ray.z);
    harness.state_mut().change(|now| now.vehicles[1].position = ground);
    harness.run_steps(2);
    click_at(&mut harness, label.center(), 1);
    assert_eq!(harness.state().state.selection.vehicle, Some(VehicleId(1)));
}
