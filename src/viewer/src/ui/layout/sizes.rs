//! Sizes of tiles: what is beside the city keeps its size in points, and the city takes the rest.

use super::{Layout, Panel};
use crate::ui::vehicles;
use egui::{Ui, Vec2};
use egui_tiles::{Container, Linear, LinearDir, Tile, TileId};

/// Least extent of a tile beside the city, points.
const LEAST: f32 = 160.0;
/// Least extent to which the user may shrink any tile, points: a title, a heading and two rows.
pub(super) const LEAST_OF_ANY: f32 = 100.0;
/// Least width of a column with previews, points: pedals and plots of a preview stay legible.
const LEAST_WITH_PREVIEWS: f32 = 240.0;
/// Usual and largest extent of a tile beside the city, points.
const USUAL: f32 = 300.0;
const LARGEST: f32 = 640.0;
/// Largest fraction of the room for a tile beside the city, and for one with the table.
const MOST: f32 = 0.333;
const MOST_WITH_TABLE: f32 = 0.36;
/// In a low room a third is too little for a chart, points.
pub(super) const LOW_ROOM: f32 = 480.0;
const MOST_IN_LOW_ROOM: f32 = 0.5;
/// Usual fractions of what is below the table, in a high and in a low room, where titles take much of that of the table.
const USUAL_BELOW_TABLE: f32 = 0.5;
const USUAL_BELOW_TABLE_IN_LOW_ROOM: f32 = 0.4;
const MOST_BELOW_TABLE: f32 = 0.8;
/// Of a third of the room, what the table leaves the city.
const LEAST_BESIDE_TABLE: f32 = 0.9;
/// Usual fractions for views beside or below the first one, and for charts, with what one chooses above the plot.
const USUAL_WITH_VIEWS: f32 = 0.45;
const USUAL_WITH_CHARTS: f32 = 0.5;

impl Layout {
    /// Gives the rows and columns around the city their sizes in a room.
    pub(super) fn fit(&mut self, ui: &Ui, mut room: Vec2) {
        let table = vehicles::least_width(ui, room.x);
        self.fitted.clear();
        self.fit_table_column(room.y);
        for (tile, city) in self.around_city() {
            let Some((dir, beside)) = self.beside(tile, city) else { continue };
            let extent = if dir == LinearDir::Horizontal { &mut room.x } else { &mut room.y };
            let is_low = dir == LinearDir::Vertical && *extent < LOW_ROOM;
            let most = if is_low { MOST_IN_LOW_ROOM } else { MOST };
            let third = (*extent * most).clamp(0.0, LARGEST);
            let mut left = *extent;
            let least: Vec<f32> = beside.iter().map(|child| self.least((dir, *extent), *child)).collect();
            for (place, child) in beside.iter().enumerate() {
                let others: f32 = least[place + 1..].iter().map(|least| least.min(third)).sum();
                let has_table = dir == LinearDir::Horizontal && self.holds(*child, Panel::Vehicles);
                let large = self.usual_of_large(*child);
                let (most, usual) = match (has_table, large) {
                    // Numbers, statuses, positions and speeds stay in view.
                    (true, _) => {
                        let city = LEAST_BESIDE_TABLE * third;
                        let most = table.min(*extent - city - others).max(*extent * MOST_WITH_TABLE);
                        (most.min(LARGEST), vehicles::usual_width(ui, *extent))
                    }
                    (false, Some(usual)) => ((left - third - others).max(0.0), *extent * usual),
                    (false, None) => (third.min((left - third - others).max(0.0)), USUAL),
                };
                let wanted = self.points.get(&child.0).copied().unwrap_or(usual);
                let points = wanted.clamp(least[place].min(most), most);
                left -= points;
                self.fitted.insert(child.0, points);
            }
            *extent = left.max(1.0);
            self.fitted.insert(city.0, *extent);
            self.share_out(tile);
        }
    }

    /// Usual fraction of the room of a tile that needs as much of it as the city; `None` for others.
    fn usual_of_large(&self, tile: TileId) -> Option<f32> {
        let panels = [
            (Panel::SecondView, USUAL_WITH_VIEWS),
            (Panel::ThirdView, USUAL_WITH_VIEWS),
            (Panel::Charts, USUAL_WITH_CHARTS),
        ];
        panels.into_iter().find(|(panel, _)| self.holds(tile, *panel)).map(|(_, usual)| usual)
    }

    /// Gives the table and what is below it their parts of a height.
    fn fit_table_column(&mut self, height: f32) {
        let Some((column, table)) = self.table_column() else { return };
        let Some((_, below)) = self.beside(column, table) else { return };
        let usual = if height < LOW_ROOM { USUAL_BELOW_TABLE_IN_LOW_ROOM } else { USUAL_BELOW_TABLE };
        let count = below.len().max(1) as f32;
        let (usual, most) = (usual * height / count, MOST_BELOW_TABLE * height / count);
        let mut left = height;
        for child in below {
            let wanted = self.points.get(&child.0).copied().unwrap_or(usual);
            let points = wanted.clamp(LEAST_OF_ANY.min(most), most);
            left -= points;
            self.fitted.insert(child.0, points);
        }
        self.fitted.insert(table.0, left.max(1.0));
        self.share_out(column);
    }

    /// Gives what is in a row or column the sizes of this frame.
    fn share_out(&mut self, container: TileId) {
        let fitted = &self.fitted;
        if let Some(Tile::Container(Container::Linear(linear))) = self.tree.tiles.get_mut(container) {
            for child in &linear.children {
                if let Some(points) = fitted.get(&child.0) {
                    linear.shares.set_share(*child, *points);
                }
            }
        }
    }

    /// Keeps the sizes that the user has given tiles; what only the room limits is not kept.
    pub(super) fn learn(&mut self) {
        for (tile, main) in self.around_city().into_iter().chain(self.table_column()) {
            let Some(linear) = self.linear(tile) else { continue };
            let beside = linear.children.iter().filter(|child| **child != main);
            let shares: Vec<_> = beside.map(|child| (child.0, linear.shares[*child])).collect();
            let is_changed = |child: &u64, share: f32| {
                self.fitted.get(child).is_some_and(|fitted| (share - fitted).abs() > 0.5)
            };
            let changed: Vec<_> =
                shares.into_iter().filter(|(child, share)| is_changed(child, *share)).collect();
            self.points.extend(changed);
        }
    }

    /// Containers that hold the city, from the root on, each with its child that does.
    fn around_city(&self) -> Vec<(TileId, TileId)> {
        let mut containers = Vec::new();
        let mut child = self.tree.tiles.find_pane(&Panel::City);
        while let Some(here) = child {
            let parent = self.tree.tiles.parent_of(here);
            containers.extend(parent.map(|parent| (parent, here)));
            child = parent;
        }
        containers.reverse();
        containers
    }

    /// The column of the table with its child that holds it, where the city is not in that column too.
    fn table_column(&self) -> Option<(TileId, TileId)> {
        let parent = |tile| self.tree.tiles.parent_of(tile);
        let tabs = parent(self.tree.tiles.find_pane(&Panel::Vehicles)?)?;
        let column = parent(tabs)?;
        let is_free = self.around_city().iter().all(|(container, _)| *container != column);
        let is_column = self.linear(column).is_some_and(|linear| linear.dir == LinearDir::Vertical);
        (is_free && is_column && self.tree.is_visible_in_layout(tabs)).then_some((column, tabs))
    }

    fn linear(&self, tile: TileId) -> Option<&Linear> {
        match self.tree.tiles.get_container(tile) {
            Some(Container::Linear(linear)) => Some(linear),
            _ => None,
        }
    }

    /// Direction of a row or column, and its visible children without the one that holds the city.
    fn beside(&self, tile: TileId, city: TileId) -> Option<(LinearDir, Vec<TileId>)> {
        let linear = self.linear(tile)?;
        let is_beside = |child: &&TileId| **child != city && self.tree.is_visible_in_layout(**child);
        Some((linear.dir, linear.children.iter().filter(is_beside).copied().collect()))
    }

    /// Least extent of a tile in a row or column of some extent.
    fn least(&self, (dir, extent): (LinearDir, f32), tile: TileId) -> f32 {
        /// A narrow window needs the room for the table.
        const MOST_WITH_PREVIEWS: f32 = 0.25;
        let is_column = dir == LinearDir::Horizontal;
        match is_column && self.holds(tile, Panel::Cameras) {
            true => LEAST_WITH_PREVIEWS.min(MOST_WITH_PREVIEWS * extent).max(LEAST),
            false => LEAST,
        }
    }

    fn holds(&self, tile: TileId, panel: Panel) -> bool {
        let pane = self.tree.tiles.find_pane(&panel).filter(|pane| self.tree.is_visible(*pane));
        std::iter::successors(pane, |here| self.tree.tiles.parent_of(*here)).any(|here| here == tile)
    }
}
