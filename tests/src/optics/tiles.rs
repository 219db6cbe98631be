//! Which solids can be seen in, or shade, each tile of a band of rows.

use crate::optics::render::Still;
use crate::optics::setting::Setting;
use crate::optics::solids::Solid;
use crate::optics::vec::V3;
use std::ops::Range;

/// Side of a tile.
pub(crate) const TILE_PX: usize = 8;

/// Numbers of solids, tile by tile.
pub(crate) struct Lists {
    seen: Vec<Vec<u16>>,
    shading: Vec<Vec<u16>>,
}

impl Lists {
    /// Looks at all states of all rows of the band.
    pub(crate) fn of(
        setting: &Setting,
        still: &[Still],
        rows: Range<usize>,
        rows_states: &[&[(f64, Vec<Solid>)]],
    ) -> Lists {
        let camera = &setting.camera;
        let count = camera.width_px.div_ceil(TILE_PX);
        let mut lists = Lists { seen: vec![Vec::new(); count], shading: vec![Vec::new(); count] };
        let middle_row = (rows.start + rows.end) as f64 * 0.5 - 0.5;
        for states in rows_states {
            for (number, (_, solids)) in states.iter().enumerate() {
                let shades = number == 0 || number == states.len() / 2 || number + 1 == states.len();
                for (k, solid) in solids.iter().enumerate() {
                    lists.mark_seen(setting, solid, k as u16, middle_row);
                    if shades && !setting.world.materials[solid.material].is_bubble {
                        lists.mark_shading(setting, still, solid, k as u16, rows.clone());
                    }
                }
            }
        }
        lists
    }

    /// Solids that can be seen at a column, and that can shade the wall there.
    pub(crate) fn at(&self, column: usize) -> (&[u16], &[u16]) {
        (&self.seen[column / TILE_PX], &self.shading[column / TILE_PX])
    }

    fn mark_seen(&mut self, setting: &Setting, solid: &Solid, k: u16, middle_row: f64) {
        let camera = &setting.camera;
        let (a, b, r) = solid.capsule();
        // What is behind the glass's far side, or far outside, cannot be seen.
        if a.y < camera.port_y_m() || b.y < camera.port_y_m() {
            return;
        }
        let nearest_y = (a.y.min(b.y) - r).max(camera.port_y_m() * 0.95);
        let reach = 1.15 * r * camera.scale_px_per_m(nearest_y) + 2.0 + TILE_PX as f64 * 0.71;
        let (pa, pb) = (camera.project(a), camera.project(b));
        let low = ((pa.0.min(pb.0) - reach).max(0.0) / TILE_PX as f64) as usize;
        let high = ((pa.0.max(pb.0) + reach).max(0.0) / TILE_PX as f64) as usize;
        if middle_row < pa.1.min(pb.1) - reach || middle_row > pa.1.max(pb.1) + reach {
            return;
        }
        for tile in low..=high.min(self.seen.len().saturating_sub(1)) {
            let c = (tile * TILE_PX) as f64 + TILE_PX as f64 * 0.5 - 0.5;
            let (dx, dy) = (pb.0 - pa.0, pb.1 - pa.1);
            let s = (((c - pa.0) * dx + (middle_row - pa.1) * dy) / (dx * dx + dy * dy).max(1e-9))
                .clamp(0.0, 1.0);
            if (c - pa.0 - s * dx).hypot(middle_row - pa.1 - s * dy) <= reach
                && self.seen[tile].last() != Some(&k)
            {
                push_once(&mut self.seen[tile], k);
            }
        }
    }

    fn mark_shading(
        &mut self,
        setting: &Setting,
        still: &[Still],
        solid: &Solid,
        k: u16,
        rows: Range<usize>,
    ) {
        let light = &setting.world.light;
        let (a, b, r) = solid.capsule();
        let w = setting.camera.width_px;
        let panel_m = light.half_m.0.hypot(light.half_m.1);
        let steps = ((b - a).norm() / r.max(1e-4)).ceil().clamp(1.0, 24.0) as usize;
        let ball_m = r + (b - a).norm() / steps as f64 * 0.5;
        let row = (rows.start + rows.end) / 2;
        for tile in 0..self.shading.len() {
            let column = (tile * TILE_PX + TILE_PX / 2).min(w - 1);
            let p = still[row * w + column].at;
            let corner = still[rows.start * w + tile * TILE_PX].at;
            let slack_m = (corner - p).norm() * 1.3;
            let to = light.middle - p;
            let far = to.norm();
            let along = to * (1.0 / far);
            for i in 0..steps {
                let c = a + (b - a) * ((i as f64 + 0.5) / steps as f64);
                if shades(c - p, along, far, ball_m, panel_m, slack_m) {
                    push_once(&mut self.shading[tile], k);
                    break;
                }
            }
        }
    }
}

/// Whether a ball lies in the widening space between a tile on a wall and the panel.
fn shades(c: V3, along: V3, far: f64, ball_m: f64, panel_m: f64, slack_m: f64) -> bool {
    let s = c.dot(along);
    if s < -ball_m || s > far + ball_m {
        return false;
    }
    let share = (s / far).clamp(0.0, 1.0);
    let reach = ball_m + panel_m * share + slack_m * (1.0 - share);
    c.dot(c) - s * s <= reach * reach
}

fn push_once(list: &mut Vec<u16>, k: u16) {
    if !list.contains(&k) {
        list.push(k);
    }
}
