//! The table of pass rates, the list of faults, and the file of all runs.

use std::{fmt::Write, path::Path, thread};

use bevy_medial_compare::{
    figures,
    stability::{hazards::Hazard, methods::Method, run::Cell},
    tables::{Table, today, write},
};

/// The results of a run.
pub struct Report<'a> {
    pub hazards: &'a [Hazard],
    pub methods: &'a [Method],
    /// Sorted by hazard, then by method.
    pub cells: &'a [Cell],
    /// The command that ran it.
    pub command: &'a str,
}

impl Report<'_> {
    fn row(&self, hazard: usize) -> impl Iterator<Item = &Cell> {
        self.cells.iter().filter(move |cell| cell.hazard == hazard)
    }

    /// Pass rates as Markdown.
    pub fn table(&self) -> String {
        let names: Vec<&str> = self.methods.iter().map(|method| method.name).collect();
        let mut text = format!("| hazard | {} |\n|---{}|\n", names.join(" | "), "|---".repeat(names.len()));
        for (number, hazard) in self.hazards.iter().enumerate() {
            let rates = self.row(number).map(|cell| {
                let (passed, count) = (cell.passed(), cell.results.len());
                if passed == count { format!("{passed}/{count}") } else { format!("**{passed}/{count}**") }
            });
            _ = writeln!(text, "| {} | {} |", hazard.name, rates.collect::<Vec<_>>().join(" | "));
        }
        text
    }

    /// For each hazard its criterion, and the first fault of each method that fails.
    pub fn faults(&self) -> String {
        let mut text = String::new();
        for (number, hazard) in self.hazards.iter().enumerate() {
            _ = writeln!(text, "- **{}**: {}.", hazard.name, hazard.criterion);
            for cell in self.row(number) {
                let first =
                    cell.results.iter().enumerate().find_map(|(seed, result)| Some((seed, result.as_ref().err()?)));
                if let Some((seed, fault)) = first {
                    _ = writeln!(text, "  - {}, seed {seed}: {fault}", self.methods[cell.method].name);
                }
            }
        }
        text
    }

    /// The criterion of each hazard. Hazards with the same criterion that follow each other share a line.
    fn criteria(&self) -> String {
        let mut text = String::new();
        for hazards in self.hazards.chunk_by(|a, b| a.criterion == b.criterion) {
            let names: Vec<&str> = hazards.iter().map(|hazard| hazard.name).collect();
            _ = writeln!(text, "- **{}**: {}.", names.join("; "), hazards[0].criterion);
        }
        text
    }

    /// A line for each run.
    fn csv(&self) -> String {
        let mut text = String::from("hazard,method,seed,passed,fault\n");
        for cell in self.cells {
            for (seed, result) in cell.results.iter().enumerate() {
                let fault = result.as_ref().err().map_or("", String::as_str).replace('"', "'");
                let (hazard, method) = (self.hazards[cell.hazard].name, self.methods[cell.method].name);
                _ = writeln!(text, "\"{hazard}\",\"{method}\",{seed},{},\"{fault}\"", result.is_ok());
            }
        }
        text
    }

    fn markdown(&self) -> String {
        let cores = thread::available_parallelism().map_or(1, usize::from);
        let failing = self.cells.iter().filter(|cell| cell.passed() < cell.results.len());
        let ours = failing.filter(|cell| self.methods[cell.method].is_ours).count();
        let mut text = format!(
            "# Stability: where methods fail\n\n\
             This page shows in which situations collision methods fail, so that you can choose one for your scenes. This crate fails in {ours} of {} cells.\n\n\
             Each hazard has one criterion for all methods, and is run with one or more seeds. On the GPU only the first seed is run, because results have the same bits \
             as on the CPU. Each cell shows how many seeds pass.\n\nCommand: `{}`. Date: {}. Cores: {cores}.\n\n![Seeds passed by each method](images/stability.svg)\n\n{}\n\
             ## Methods\n\n",
            self.cells.iter().filter(|cell| self.methods[cell.method].is_ours).count(),
            self.command,
            today(),
            self.table(),
        );
        for method in self.methods {
            _ = writeln!(text, "- **{}**: {}.", method.name, method.about);
        }
        _ = write!(
            text,
            "\nAll methods have the same bodies, masses and friction, and their default settings. \"Bullets\" are the fast bodies of hazards about speed. Their speed \
             has no limit in any method. Rapier's gyroscopic term is off for them, because it is explicit in time and adds energy to a fast spin in free flight. \
             Shapes are the same sets of points: medial meshes in this crate, and compounds of balls, capsules, rounded triangles and convex hulls in the \
             others. Boxes without rounding are boxes.\n\n## Criteria\n\n`benches/results/stability.csv` has the fault of each seed that fails.\n\n{}",
            self.criteria()
        );
        text
    }

    /// Writes `stability.csv`, `stability.md` and `images/stability.svg`.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), String> {
        let images = folder.join("images");
        std::fs::create_dir_all(&images).map_err(|error| format!("{}: {error}", images.display()))?;
        for (name, text) in [("stability.csv", self.csv()), ("stability.md", self.markdown())] {
            write(&folder.join(name), &text)?;
        }
        let (name, chart) = figures::stability(&Table::new(&self.csv()));
        write(&images.join(name).with_extension("svg"), &chart)
    }
}
