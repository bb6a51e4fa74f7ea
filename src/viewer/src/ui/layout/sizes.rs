//! Sizes of tiles: what is beside the city keeps its size in points, and the city takes the rest.

use super::{Layout, Panel};
use crate::ui::vehicles;
use egui::{Ui, Vec2};
use egui_tiles::{Container, Linear, LinearDir, Tile, TileId};

/// Least extent of a tile, points.
pub(super) const LEAST: f32 = 160.0;
/// Usual and largest extent of a tile beside the city, points.
const USUAL: f32 = 300.0;
const LARGEST: f32 = 640.0;
/// Largest fraction of the room for a tile beside the city, and for one with the table.
const MOST: f32 = 0.333;
const MOST_WITH_TABLE: f32 = 0.36;

impl Layout {
    /// Gives the rows and columns around the city their sizes in a room.
    pub(super) fn fit(&mut self, ui: &Ui, mut room: Vec2) {
        let table = vehicles::least_width(ui);
        self.fitted.clear();
        for (tile, city) in self.around_city() {
            let Some((dir, beside)) = self.beside(tile, city) else { continue };
            let extent = if dir == LinearDir::Horizontal { &mut room.x } else { &mut room.y };
            let third = (*extent * MOST).clamp(0.0, LARGEST);
            let others = LEAST.min(third) * beside.len().saturating_sub(1) as f32;
            let mut left = *extent;
            for child in beside {
                let has_table = dir == LinearDir::Horizontal && self.holds(child, Panel::Vehicles);
                let most = if has_table {
                    // Numbers, statuses, positions and speeds stay in view.
                    table.min(*extent - third - others).max(*extent * MOST_WITH_TABLE).min(LARGEST)
                } else {
                    third.min((left - third).max(0.0))
                };
                let wanted = self.points.get(&child.0).copied().unwrap_or(USUAL);
                let points = wanted.clamp(LEAST.min(most), most);
                left -= points;
                self.fitted.insert(child.0, points);
            }
            *extent = left.max(1.0);
            self.fitted.insert(city.0, *extent);
            let fitted = &self.fitted;
            if let Some(Tile::Container(Container::Linear(linear))) = self.tree.tiles.get_mut(tile) {
                for child in &linear.children {
                    if let Some(points) = fitted.get(&child.0) {
                        linear.shares.set_share(*child, *points);
                    }
                }
            }
        }
    }

    /// Keeps the sizes that the user has given tiles; what only the room limits is not kept.
    pub(super) fn learn(&mut self) {
        for (tile, city) in self.around_city() {
            let Some(linear) = self.linear(tile) else { continue };
            let beside = linear.children.iter().filter(|child| **child != city);
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

    fn holds(&self, tile: TileId, panel: Panel) -> bool {
        let pane = self.tree.tiles.find_pane(&panel).filter(|pane| self.tree.is_visible(*pane));
        std::iter::successors(pane, |here| self.tree.tiles.parent_of(*here)).any(|here| here == tile)
    }
}
