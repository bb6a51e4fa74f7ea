//! A layout as it is kept in the settings.

use super::{Layout, Panel};
use crate::ui::OpenPanels;
use crate::ui::panels::{Home, entry};
use egui_tiles::{Container, LinearDir, Tile, TileId, Tiles, Tree};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// The layout in the settings: tiles as a tree, floating panels, and which are open.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoredLayout {
    /// Panels that are open.
    pub open: OpenPanels,
    floating: BTreeSet<Panel>,
    root: StoredTile,
}

/// A tile with what it holds, and its size in points where the user has set it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct StoredTile {
    size: Option<f32>,
    holds: Held,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Held {
    Panel(Panel),
    Tabs { active: usize, tiles: Vec<StoredTile> },
    Row { shares: Vec<f32>, tiles: Vec<StoredTile> },
    Column { shares: Vec<f32>, tiles: Vec<StoredTile> },
}

impl Layout {
    /// The layout for the settings; `None` where there is nothing to keep.
    pub fn stored(&self, open: OpenPanels) -> Option<StoredLayout> {
        let root = self.store(self.tree.root?)?;
        let is_kept = |panel: &Panel| entry(*panel).home != Home::ChartsRow || self.chosen.contains(panel);
        let floating = self.floating.iter().copied().filter(is_kept).collect();
        Some(StoredLayout { open, floating, root })
    }

    fn store(&self, tile: TileId) -> Option<StoredTile> {
        let tiles = |children: &mut dyn Iterator<Item = &TileId>| -> Vec<StoredTile> {
            children.filter_map(|child| self.store(*child)).collect()
        };
        let holds = match self.tree.tiles.get(tile)? {
            Tile::Pane(panel) => Held::Panel(*panel),
            Tile::Container(Container::Linear(linear)) => {
                let shares = linear.children.iter().map(|child| linear.shares[*child]).collect();
                let tiles = tiles(&mut linear.children.iter());
                match linear.dir {
                    LinearDir::Horizontal => Held::Row { shares, tiles },
                    LinearDir::Vertical => Held::Column { shares, tiles },
                }
            }
            Tile::Container(Container::Tabs(tabs)) => {
                let active = tabs.children.iter().position(|child| Some(*child) == tabs.active);
                Held::Tabs { active: active.unwrap_or(0), tiles: tiles(&mut tabs.children.iter()) }
            }
            Tile::Container(Container::Grid(grid)) => {
                let tiles = tiles(&mut grid.children());
                Held::Row { shares: vec![1.0; tiles.len()], tiles }
            }
        };
        Some(StoredTile { size: self.points.get(&tile.0).copied(), holds })
    }
}

impl From<&StoredLayout> for Layout {
    /// The usual layout where the stored one has the city or another panel twice, or no city.
    fn from(stored: &StoredLayout) -> Self {
        let (mut tiles, mut points) = (Tiles::default(), BTreeMap::new());
        let root = stored.root.insert(&mut tiles, &mut points);
        let panels: Vec<Panel> = tiles
            .tiles()
            .filter_map(|tile| match tile {
                Tile::Pane(panel) => Some(*panel),
                Tile::Container(_) => None,
            })
            .collect();
        let distinct: BTreeSet<&Panel> = panels.iter().collect();
        if distinct.len() != panels.len() || !distinct.contains(&Panel::City) {
            return Self::default();
        }
        let mut floating = stored.floating.clone();
        floating.remove(&Panel::City);
        let tree = Tree::new(egui::Id::unique("layout"), root, tiles);
        Self::of(tree, floating, points)
    }
}

impl StoredTile {
    fn insert(&self, tiles: &mut Tiles<Panel>, points: &mut BTreeMap<u64, f32>) -> TileId {
        let tile = match &self.holds {
            Held::Panel(panel) => tiles.insert_pane(*panel),
            Held::Tabs { active, tiles: held } => {
                let children: Vec<TileId> = held.iter().map(|tile| tile.insert(tiles, points)).collect();
                let mut tabs = egui_tiles::Tabs::new(children);
                tabs.active = tabs.children.get(*active).copied();
                tiles.insert_container(tabs)
            }
            Held::Row { shares, tiles: held } => {
                linear(LinearDir::Horizontal, (shares.as_slice(), held.as_slice()), tiles, points)
            }
            Held::Column { shares, tiles: held } => {
                linear(LinearDir::Vertical, (shares.as_slice(), held.as_slice()), tiles, points)
            }
        };
        points.extend(self.size.filter(|size| size.is_finite()).map(|size| (tile.0, size)));
        tile
    }
}

fn linear(
    dir: LinearDir,
    (shares, held): (&[f32], &[StoredTile]),
    tiles: &mut Tiles<Panel>,
    points: &mut BTreeMap<u64, f32>,
) -> TileId {
    let children = held.iter().map(|tile| tile.insert(tiles, points)).collect();
    let mut linear = egui_tiles::Linear::new(dir, children);
    let usable = |share: &f32| share.is_finite() && *share > 0.0;
    for (child, share) in linear.children.iter().zip(shares).filter(|(_, share)| usable(share)) {
        linear.shares.set_share(*child, *share);
    }
    tiles.insert_container(linear)
}
