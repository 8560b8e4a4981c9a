//! Counts the cells of pieces, and makes their points. Program: `shaders/points_cells.wgsl`.

use crate::layout::{PointPiece, PointStep};
use argus_gpu::wgpu::{Buffer, BufferUsages};
use bytes::Bytes;

use super::{PointPasses, PointsError};
use argus_gpu::ScanSums;

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

impl CountedCells {
    /// Number of cells of all pieces.
    pub fn cells(&self) -> u32 {
        self.cells
    }
}

impl PointPasses {
    /// Counts the cells that pieces touch. All pieces together must touch fewer than 2³² cells.
    ///
    /// # Errors
    /// Pieces or rows exceed an array, or the device failed.
    pub fn count(&self, pieces: &[PointPiece]) -> Result<CountedCells, PointsError> {
        self.fits("pieces of triangles", size_of_val(pieces) as u64)?;
        let piece_count = pieces.len() as u32;
        let pieces = self.gpu.upload("pieces of triangles", pieces, BufferUsages::STORAGE);
        let first_row = self.array("first rows of pieces", 4 * u64::from(piece_count))?;
        let step = PointStep { count: piece_count, pieces: piece_count, rows: 0 };
        let mut commands = self.gpu.commands("count rows");
        commands
            .compute("rows", &self.count_rows)
            .read("pieces", &pieces)
            .write("row_counts", &first_row)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(piece_count));
        let sums = ScanSums::new(&self.gpu, u64::from(piece_count));
        self.scan.run(&mut commands, "rows", &first_row, piece_count, &sums);
        let total = commands.read_buffer(sums.total(), 0..4);
        let rows: u32 = bytemuck::pod_read_unaligned(&commands.submit().wait()?.take(total));

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
        Ok(CountedCells { pieces, piece_count, rows, first_row, first_cell, cells })
    }

    /// Makes the points of all cells, in the order of pieces, rows and columns. Returns them on the device, and their bytes: the
    /// column and the row in 16 bits each, then the piece in 32, little-endian.
    ///
    /// # Errors
    /// Points exceed an array, or the device failed.
    pub fn points(&self, cells: &CountedCells) -> Result<(Points, Bytes), PointsError> {
        let count = cells.cells;
        let buffer = self.array("points", 8 * u64::from(count))?;
        let step = PointStep { count, pieces: cells.piece_count, rows: cells.rows };
        let mut commands = self.gpu.commands("make points");
        commands
            .compute("points", &self.make_points)
            .read("pieces", &cells.pieces)
            .read("first_row", &cells.first_row)
            .read("first_cell", &cells.first_cell)
            .write("points", &buffer)
            .immediates(bytemuck::bytes_of(&step))
            .dispatch_linear(u64::from(count));
        let bytes = commands.read_buffer(&buffer, 0..8 * u64::from(count));
        let bytes = commands.submit().wait()?.take(bytes);
        Ok((Points { buffer, count }, bytes))
    }
}
