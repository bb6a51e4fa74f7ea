//! Panels and their places: docked around the city as tiles that are moved, resized and hidden, or floating over it.

mod floating;
mod sizes;
mod stored;

pub use stored::StoredLayout;

use self::floating::FloatingPlaces;
pub(super) use self::floating::moved_to;
use super::panels::{self, Home, Panel, PanelEntry, entry};
use super::{UiAction, UiState, ViewModel};
use egui::{Rect, Ui, Vec2, WidgetText, vec2};
use egui_tiles::{
    Behavior, Container, LinearDir, SimplificationOptions, Tabs, TileId, Tiles, Tree, UiResponse,
};
use std::collections::{BTreeMap, BTreeSet};

/// Where the panels are. A closed panel keeps its place.
#[derive(Clone, Debug)]
pub struct Layout {
    tree: Tree<Panel>,
    floating: BTreeSet<Panel>,
    /// Panels that the user has docked or lifted: whether the charts are over the city is up to the room there is, otherwise.
    chosen: BTreeSet<Panel>,
    /// Sizes that the user has given what is beside the city, by tile, points; the city takes the rest.
    points: BTreeMap<u64, f32>,
    /// Sizes in this frame, which the room may limit.
    fitted: BTreeMap<u64, f32>,
    /// Floating panels that were open in the last frame.
    lifted: BTreeSet<Panel>,
    /// Docked panels that open in this frame, which those over the city must not hide.
    opening: Vec<TileId>,
    /// The docked panel that was opened last.
    opened: Option<TileId>,
}

impl Default for Layout {
    fn default() -> Self {
        let mut tiles = Tiles::default();
        let mut tabs = |panels: &[Panel]| {
            let panes = panels.iter().map(|panel| tiles.insert_pane(*panel)).collect();
            tiles.insert_tab_tile(panes)
        };
        let (vehicles, below) = (tabs(&[Panel::Vehicles]), tabs(&panels::with_home(Home::BelowVehicles)));
        let (city, cameras) = (tabs(&[Panel::City]), tabs(&panels::with_home(Home::Right)));
        let charts = tabs(&panels::with_home(Home::ChartsRow));
        let views = panels::with_home(Home::ViewsRow).into_iter().map(|panel| tabs(&[panel])).collect();
        let left = tiles.insert_vertical_tile(vec![vehicles, below]);
        let views = tiles.insert_horizontal_tile(views);
        let middle = tiles.insert_vertical_tile(vec![city, views, charts]);
        let root = tiles.insert_horizontal_tile(vec![left, middle, cameras]);
        let tree = Tree::new(egui::Id::unique("layout"), root, tiles);
        let points = [(cameras.0, RIGHT)].into();
        let floating = panels::with_home(Home::Floating).into_iter().collect();
        Self::of(tree, floating, points)
    }
}

/// Width of the column with the previews, points.
const RIGHT: f32 = 284.0;
/// A mouse that has not moved for so long uses nothing, seconds.
const IN_USE_S: f32 = 2.0;
/// In a narrower bar two titles find room beside a sign alone, points.
const NARROW_TABS: f32 = 240.0;
/// Height of the bar with the titles, points.
const TAB_BAR: f32 = 22.0;

/// Shows all open panels.
pub(super) fn show(ui: &mut Ui, state: &mut UiState, shown: &ViewModel<'_>, actions: &mut Vec<UiAction>) {
    // Panels do not change the layout while it is shown.
    let mut layout = std::mem::take(&mut state.layout);
    let room = ui.available_rect_before_wrap();
    layout.update(state, room.height());
    layout.fit(ui, room.size());
    let (hidden, city) = (layout.hidden(), layout.tree.tiles.find_pane(&Panel::City));
    let mut dock = Dock { state, shown, actions, hidden, city, closed: None, lifted: None };
    layout.tree.ui(&mut dock, ui);
    let (closed, lifted) = (dock.closed, dock.lifted);
    layout.learn();
    layout.show_floating(ui, (state, room), shown, actions);
    if let Some(panel) = closed {
        (entry(panel).close)(state);
    }
    if let Some(panel) = lifted {
        layout.choose_floating(panel, true);
    }
    state.layout = layout;
}

impl Layout {
    /// A layout of which nothing has been shown yet.
    fn of(tree: Tree<Panel>, floating: BTreeSet<Panel>, points: BTreeMap<u64, f32>) -> Self {
        let chosen = floating.iter().copied().filter(|panel| entry(*panel).home == Home::ChartsRow).collect();
        let (fitted, lifted) = (BTreeMap::new(), BTreeSet::new());
        Self { tree, floating, chosen, points, fitted, lifted, opening: Vec::new(), opened: None }
    }

    /// Whether a panel is over the city, not beside it.
    pub fn is_floating(&self, panel: Panel) -> bool {
        self.floating.contains(&panel)
    }

    /// Docks a floating panel, or lifts a docked one.
    pub fn toggle_floating(&mut self, panel: Panel) {
        if panel != Panel::City {
            self.choose_floating(panel, !self.is_floating(panel));
        }
    }

    /// Lifts or docks a panel for the user.
    fn choose_floating(&mut self, panel: Panel, floats: bool) {
        self.chosen.insert(panel);
        self.set_floating(panel, floats);
    }

    fn set_floating(&mut self, panel: Panel, floats: bool) {
        match floats {
            true => self.floating.insert(panel),
            false => self.floating.remove(&panel),
        };
    }

    /// Brings a docked panel to the front; returns whether it was behind another one.
    pub fn raise(&mut self, panel: Panel) -> bool {
        let Some(tile) = self.tree.tiles.find_pane(&panel).filter(|_| !self.is_floating(panel)) else {
            return false;
        };
        let tabs = self.tree.tiles.parent_of(tile).and_then(|parent| self.tree.tiles.get_container(parent));
        let is_behind =
            matches!(tabs, Some(Container::Tabs(tabs)) if tabs.active.is_some_and(|active| active != tile));
        is_behind && self.tree.make_active(|id, _| id == tile)
    }

    /// Brings the tiles into line with the panels that are open, in a room of some height.
    fn update(&mut self, state: &UiState, height: f32) {
        self.opening.clear();
        for PanelEntry { panel, is_open, home, .. } in &panels::ALL {
            let place = self.tree.tiles.find_pane(panel);
            if *home == Home::ChartsRow && !self.chosen.contains(panel) {
                // In a low room neither the city nor the plot would be more than a stripe.
                self.set_floating(*panel, height < sizes::LOW_ROOM);
            }
            let is_docked = is_open(state) && !self.is_floating(*panel);
            let tile = match place {
                Some(tile) => tile,
                None if is_docked => self.insert(*panel, *home),
                None => continue,
            };
            let was_docked = place.is_some() && self.tree.is_visible(tile);
            self.tree.set_visible(tile, is_docked);
            if is_docked && !was_docked {
                self.tree.make_active(|id, _| id == tile);
                self.opening.push(tile);
                self.opened = Some(tile);
            }
        }
    }

    /// Puts a panel that has no tile beside those that are at its home, else below the vehicles, else anywhere.
    fn insert(&mut self, panel: Panel, home: Home) -> TileId {
        let tile = self.tree.tiles.insert_pane(panel);
        let beside = panels::with_home(home).into_iter().chain(panels::with_home(Home::BelowVehicles));
        let beside = beside.chain([Panel::Vehicles]).filter(|other| *other != panel);
        let tabs = beside
            .filter_map(|other| self.tree.tiles.find_pane(&other))
            .find_map(|other| self.tree.tiles.parent_of(other));
        if let Some(column) = self.column_of_city().filter(|_| home == Home::ChartsRow) {
            let tabs = self.tree.tiles.insert_tab_tile(vec![tile]);
            self.tree.move_tile_to_container(tabs, column, usize::MAX, false);
        } else if let Some(tabs) = tabs {
            self.tree.move_tile_to_container(tile, tabs, usize::MAX, false);
        } else if let Some(root) = self.tree.root {
            let tabs = self.tree.tiles.insert_tab_tile(vec![tile]);
            self.tree.root = Some(self.tree.tiles.insert_horizontal_tile(vec![root, tabs]));
        }
        tile
    }

    /// The column that the city is in, where there is one.
    fn column_of_city(&self) -> Option<TileId> {
        let parent = |tile| self.tree.tiles.parent_of(tile);
        let column = parent(parent(self.tree.tiles.find_pane(&Panel::City)?)?)?;
        let is_column = |container: &Container| matches!(container, Container::Linear(linear) if linear.dir == LinearDir::Vertical);
        self.tree.tiles.get_container(column).filter(|container| is_column(container)).map(|_| column)
    }

    fn hidden(&self) -> BTreeSet<u64> {
        let tiles = self.tree.tiles.tile_ids();
        tiles.filter(|tile| !self.tree.is_visible(*tile)).map(|tile| tile.0).collect()
    }

    /// Where a window that opens by itself hides the least: neither the vehicle that the user looks at, nor the table, nor a
    /// panel over the city.
    pub(super) fn place_beside(
        ui: &Ui,
        size: Vec2,
        (state, shown): (&UiState, &ViewModel<'_>),
    ) -> egui::Pos2 {
        let window = ui.ctx().content_rect();
        let city = state.layout.city().unwrap_or(window);
        let vehicle = super::city::watched(state, shown, city);
        let rects = |panel: &Panel| ui.ctx().memory(|memory| memory.area_rect(window_of(*panel)));
        let taken: Vec<Rect> = state.layout.lifted.iter().filter_map(rects).collect();
        // The bars above and below stay in sight.
        let panels = state.layout.tree.root.and_then(|root| state.layout.tree.tiles.rect(root));
        let room = panels.unwrap_or(window).shrink(8.0);
        let mut kept = state.layout.kept(shown, state.viewpoint.follow.is_some());
        kept.extend(state.layout.opened.and_then(|tile| state.layout.shown_rect(tile)));
        FloatingPlaces { city, room, vehicle, kept }.free((None, size), &taken)
    }

    /// Whether a docked panel opens beneath a window at a place.
    pub(super) fn opens_beneath(&self, place: Rect) -> bool {
        self.opening_rects().into_iter().any(|opening| opening.intersects(place))
    }

    /// Where docked panels open in this frame.
    fn opening_rects(&self) -> Vec<Rect> {
        self.opening.iter().filter_map(|tile| self.shown_rect(*tile)).collect()
    }

    fn shown_rect(&self, tile: TileId) -> Option<Rect> {
        self.tree.tiles.rect(tile).filter(|_| self.tree.is_visible(tile))
    }

    /// Whether a window at a place is in the way: over a panel in which the mouse moves.
    pub(super) fn is_in_the_way(&self, ui: &Ui, place: Rect) -> bool {
        let floating = self.lifted.iter().filter_map(|panel| {
            let id = window_of(*panel);
            ui.ctx().memory(|memory| memory.area_rect(id))
        });
        let mouse = ui.input(|input| {
            let moves = input.pointer.time_since_last_movement() < IN_USE_S;
            input.pointer.hover_pos().filter(|_| moves)
        });
        let has_mouse = |rect: &Rect| mouse.is_some_and(|mouse| rect.contains(mouse));
        let beside = panels::ALL.iter().map(|entry| entry.panel).filter(|panel| *panel != Panel::City);
        let docked = beside.filter_map(|panel| self.docked(panel));
        floating.chain(docked).filter(has_mouse).any(|other| other.intersects(place))
    }

    /// Where a panel beside the city is; `None` for one that is closed, behind another one, or over the city.
    fn docked(&self, panel: Panel) -> Option<Rect> {
        self.shown_rect(self.tree.tiles.find_pane(&panel).filter(|_| !self.is_floating(panel))?)
    }

    /// What has to stay in sight: the rows of the table, below which it is empty, the previews, and whose camera the view is where
    /// it goes with a vehicle.
    fn kept(&self, shown: &ViewModel<'_>, is_followed: bool) -> Vec<Rect> {
        let rows = super::vehicles::height_of(shown.run_state.now.vehicles.len());
        let table = self.docked(Panel::Vehicles);
        let table = table.map(|table| table.with_max_y(table.bottom().min(table.top() + rows)));
        let name = self.city().filter(|_| is_followed);
        let name = name.map(|city| Rect::from_min_size(city.min, super::city::NAME_OF_CAMERA));
        table.into_iter().chain(self.docked(Panel::Cameras)).chain(name).collect()
    }

    fn city(&self) -> Option<Rect> {
        self.tree.tiles.rect(self.tree.tiles.find_pane(&Panel::City)?)
    }

    fn show_floating(
        &mut self,
        ui: &Ui,
        (state, room): (&mut UiState, Rect),
        shown: &ViewModel<'_>,
        actions: &mut Vec<UiAction>,
    ) {
        let city = self.city().unwrap_or_else(|| ui.ctx().content_rect());
        let places = FloatingPlaces {
            city,
            // The bars above and below stay in sight.
            room: room.shrink(4.0),
            vehicle: super::city::watched(state, shown, city),
            kept: self.kept(shown, state.viewpoint.follow.is_some()),
        };
        let is_lifted = |entry: &&PanelEntry| (entry.is_open)(state) && self.is_floating(entry.panel);
        let open: Vec<&PanelEntry> = panels::ALL.iter().filter(is_lifted).collect();
        let rects = |panel: &Panel| ui.ctx().memory(|memory| memory.area_rect(window_of(*panel)));
        let opening = self.opening_rects();
        let mut taken: Vec<Rect> = self.lifted.iter().filter_map(rects).collect();
        let was_open = std::mem::replace(&mut self.lifted, open.iter().map(|entry| entry.panel).collect());
        for PanelEntry { panel, title, size, close, show, .. } in open {
            let size = Vec2::from(*size).min(places.room.size());
            let size = if was_open.contains(panel) { size } else { places.fitting(size, &taken) };
            let (mut stays_open, mut stays_floating) = (true, true);
            let mut floating = egui::Window::new(*title)
                .id(window_of(*panel))
                .open(&mut stays_open)
                .default_size(size)
                .resizable(true)
                .collapsible(false)
                .constrain_to(places.room);
            let before = rects(panel);
            let hides = |before: Rect| opening.iter().any(|other| other.intersects(before));
            if !was_open.contains(panel) {
                floating = moved_to(floating, places.free((before, size), &taken));
            } else if let Some(before) = before.filter(|before| hides(*before)) {
                let others: Vec<Rect> = taken.iter().copied().filter(|other| *other != before).collect();
                let places = FloatingPlaces { kept: [&places.kept[..], &opening].concat(), ..places.clone() };
                floating = moved_to(floating, places.free((Some(before), size), &others));
            }
            let response = floating.show(ui.ctx(), |ui| {
                stays_floating = !dock_button(ui);
                show(ui, state, shown, actions);
            });
            if let Some(response) = response.filter(|_| !was_open.contains(panel)) {
                ui.ctx().move_to_top(response.response.layer_id);
                taken.push(response.response.rect);
            }
            if !stays_open {
                close(state);
            }
            if !stays_floating {
                self.choose_floating(*panel, false);
            }
        }
    }
}

/// The window of a panel over the city.
fn window_of(panel: Panel) -> egui::Id {
    egui::Id::unique(("floating", panel))
}

fn dock_button(ui: &mut Ui) -> bool {
    let line = vec2(ui.available_width(), ui.spacing().interact_size.y);
    let layout = egui::Layout::right_to_left(egui::Align::Center);
    let dock = ui.allocate_ui_with_layout(line, layout, |ui| ui.small_button("Dock")).inner;
    dock.on_hover_text("Put it beside the city").clicked()
}

/// Shows the tiles of one frame, and notes what their buttons ask for.
struct Dock<'a, 'v> {
    state: &'a mut UiState,
    shown: &'a ViewModel<'v>,
    actions: &'a mut Vec<UiAction>,
    hidden: BTreeSet<u64>,
    city: Option<TileId>,
    closed: Option<Panel>,
    lifted: Option<Panel>,
}

impl Behavior<Panel> for Dock<'_, '_> {
    fn pane_ui(&mut self, ui: &mut Ui, _tile: TileId, panel: &mut Panel) -> UiResponse {
        let show = entry(*panel).show;
        if *panel == Panel::City {
            show(ui, self.state, self.shown, self.actions);
        } else {
            egui::Frame::new().inner_margin(egui::Margin::symmetric(8, 4)).show(ui, |ui| {
                // A panel keeps its size whatever it holds.
                ui.set_min_size(ui.available_size().max(Vec2::ZERO));
                show(ui, self.state, self.shown, self.actions);
            });
        }
        UiResponse::None
    }

    fn tab_title_for_pane(&mut self, panel: &Panel) -> WidgetText {
        entry(*panel).title.into()
    }

    fn is_tab_closable(&self, _tiles: &Tiles<Panel>, tile: TileId) -> bool {
        Some(tile) != self.city
    }

    fn on_tab_close(&mut self, tiles: &mut Tiles<Panel>, tile: TileId) -> bool {
        self.closed = tiles.get_pane(&tile).copied();
        // A closed panel keeps its place.
        false
    }

    fn top_bar_right_ui(
        &mut self,
        tiles: &Tiles<Panel>,
        ui: &mut Ui,
        _tile: TileId,
        tabs: &Tabs,
        _scroll: &mut f32,
    ) {
        let active = tabs.active.filter(|tile| Some(*tile) != self.city);
        let Some(panel) = active.and_then(|tile| tiles.get_pane(&tile)) else { return };
        let is_narrow = tabs.children.len() > 1 && ui.available_width() < NARROW_TABS;
        let text = if is_narrow { "\u{23cf}" } else { "Float" };
        if ui.small_button(text).on_hover_text("Float: lift this panel over the city").clicked() {
            self.lifted = Some(*panel);
        }
    }

    fn tab_bar_height(&self, _style: &egui::Style) -> f32 {
        TAB_BAR
    }

    /// The city alone needs no title.
    fn is_tab_bar_visible(&self, _tile: TileId, tabs: &Tabs) -> bool {
        let mut shown = tabs.children.iter().filter(|tile| !self.hidden.contains(&tile.0));
        !(shown.next() == self.city.as_ref() && shown.next().is_none())
    }

    fn min_size(&self) -> f32 {
        sizes::LEAST_OF_ANY
    }

    fn simplification_options(&self) -> SimplificationOptions {
        SimplificationOptions { all_panes_must_have_tabs: true, ..SimplificationOptions::default() }
    }
}
