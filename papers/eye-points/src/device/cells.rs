//! Counts the cells of pieces, and makes their points. Program: `shaders/points_cells.wgsl`.

use crate::layout::{PointPiece, PointStep};
use argus_gpu::wgpu::{Buffer, BufferUsages};
use bytes::Bytes;

use super::{PointPasses, PointsError};
use argus_gpu::{Commands, ScanSums};

/// Pieces on the device, with their rows and cells counted.
#[derive(Debug)]
pub struct CountedCells {
    pub(super) pieces: Buffer,
    pub(super) piece_count: u32,
    rows: u32,
    first_row: Buffer,
    first_cell: Buffer,
    cells: u32,
}

/// Points on the device.
#[derive(Debug)]
pub struct Points {
    pub(super) buffer: Buffer,
    pub(super) count: u32,
}

/// What counting found.
#[derive(Debug)]
pub enum CellCount {
    /// The cells.
    Counted(CountedCells),
    /// So many at most, which is more than 32 bits can number.
    TooMany(u64),
}

/// Cells of a unit in which an upper bound of their number is summed: 32 bits then suffice for 2⁴⁰ cells.
const BOUND_UNIT: u64 = 256;

impl CountedCells {
    /// Number of cells of all pieces.
    pub fn cells(&self) -> u32 {
        self.cells
    }

    /// Number of pieces.
    pub fn pieces(&self) -> u32 {
        self.piece_count
    }
}

impl PointPasses {
    /// Uploads pieces, and counts the cells that they touch. All pieces together must touch fewer than 2³² cells.
    ///
    /// # Errors
    /// Pieces or rows exceed an array, or the device failed.
    pub fn count(&self, pieces: &[PointPiece]) -> Result<CountedCells, PointsError> {
        self.fits("pieces of triangles", size_of_val(pieces) as u64)?;
        let on_device = self.gpu.upload("pieces of triangles", pieces, BufferUsages::STORAGE);
        match self.count_on_device(on_device, pieces.len() as u32)? {
            CellCount::Counted(counted) => Ok(counted),
            CellCount::TooMany(cells) => {
                Err(PointsError::TooLarge { what: "points", needed: 8 * cells, limit: self.largest })
            }
        }
    }

    /// Counts the cells that pieces touch which are on the device.
    ///
    /// # Errors
    /// Rows exceed an array, or the device failed.
    pub fn count_on_device(&self, pieces: Buffer, piece_count: u32) -> Result<CellCount, PointsError> {
        let first_row = self.array("first rows of pieces", 4 * u64::from(piece_count))?;
        let bounds = self.array("bounds of cells", 4 * u64::from(piece_count))?;
        let step = PointStep { count: piece_count, pieces: piece_count, rows: 0 };
        let mut commands = self.gpu.commands("count rows");
        commands
            .compute("rows", &self.count_rows)
            .read("pieces", &pieces)
            .write("row_counts", &first_row)
            .write("cell_bounds", &bounds)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(piece_count));
        let [sums, bound_sums] = [(); 2].map(|()| ScanSums::new(&self.gpu, u64::from(piece_count)));
        self.scan.run(&mut commands, "rows", &first_row, piece_count, &sums);
        self.scan.run(&mut commands, "rows", &bounds, piece_count, &bound_sums);
        let [rows, bound] = [&sums, &bound_sums].map(|sums| commands.read_buffer(sums.total(), 0..4));
        let mut finished = commands.submit().wait()?;
        let [rows, bound] =
            [rows, bound].map(|total| bytemuck::pod_read_unaligned::<u32>(&finished.take(total)));
        let most = u64::from(bound) * BOUND_UNIT;
        if most > u64::from(u32::MAX) {
            return Ok(CellCount::TooMany(most));
        }

        let first_cell = self.array("first points of rows", 4 * u64::from(rows))?;
        let step = PointStep { count: rows, rows, ..step };
        let mut commands = self.gpu.commands("count cells");
        commands
            .compute("cells", &self.count_cells)
            .read("pieces", &pieces)
            .read("first_row", &first_row)
            .write("cell_counts", &first_cell)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(rows));
        let sums = ScanSums::new(&self.gpu, u64::from(rows));
        self.scan.run(&mut commands, "cells", &first_cell, rows, &sums);
        let total = commands.read_buffer(sums.total(), 0..4);
        let cells = bytemuck::pod_read_unaligned(&commands.submit().wait()?.take(total));
        Ok(CellCount::Counted(CountedCells { pieces, piece_count, rows, first_row, first_cell, cells }))
    }

    /// Makes the points of all cells on the device, in the order of pieces, rows and columns.
    ///
    /// # Errors
    /// Points exceed an array.
    pub fn points_on_device(&self, cells: &CountedCells) -> Result<Points, PointsError> {
        let count = cells.cells;
        let buffer = self.array("points", 8 * u64::from(count))?;
        let mut commands = self.gpu.commands("make points");
        self.make(&mut commands, cells, &buffer);
        commands.submit();
        Ok(Points { buffer, count })
    }

    fn make(&self, commands: &mut Commands, cells: &CountedCells, points: &Buffer) {
        let step = PointStep { count: cells.cells, pieces: cells.piece_count, rows: cells.rows };
        commands
            .compute("points", &self.make_points)
            .read("pieces", &cells.pieces)
            .read("first_row", &cells.first_row)
            .read("first_cell", &cells.first_cell)
            .write("points", points)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(cells.cells));
    }

    /// Makes the points of all cells, in the order of pieces, rows and columns. Returns them on the device, and their bytes: the
    /// column and the row in 16 bits each, then the piece in 32, little-endian.
    ///
    /// # Errors
    /// Points exceed an array, or the device failed.
    pub fn points(&self, cells: &CountedCells) -> Result<(Points, Bytes), PointsError> {
        let count = cells.cells;
        let buffer = self.array("points", 8 * u64::from(count))?;
        let mut commands = self.gpu.commands("make points");
        self.make(&mut commands, cells, &buffer);
        let bytes = commands.read_buffer(&buffer, 0..8 * u64::from(count));
        let bytes = commands.submit().wait()?.take(bytes);
        Ok((Points { buffer, count }, bytes))
    }

    /// Reads points back: the column and the row in 16 bits each, then the piece in 32, lowest first.
    ///
    /// # Errors
    /// The device failed.
    pub fn read_points(&self, points: &Points) -> Result<Vec<u64>, PointsError> {
        let mut commands = self.gpu.commands("read points");
        let bytes = commands.read_buffer(&points.buffer, 0..8 * u64::from(points.count));
        let bytes = commands.submit().wait()?.take(bytes);
        Ok(bytemuck::pod_collect_to_vec(&bytes[..8 * points.count as usize]))
    }
}
