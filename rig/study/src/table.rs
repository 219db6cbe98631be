//! The table of a study: every number with its interval and where it comes from, a row each, in the order of the tasks.

use anyhow::anyhow;
use app::Failure;
use record::files::Part;

use crate::parquet::{Cell, Column, Kind, Writer};
use crate::plan::Subject;
use crate::results::Number;
use crate::task::{By, Task};

/// The columns, in order.
pub const COLUMNS: [Column; 23] = [
    Column("task", Kind::Text),
    Column("experiment", Kind::Text),
    Column("variation", Kind::Text),
    Column("seed", Kind::Integer),
    Column("resample_by", Kind::Text),
    Column("resample", Kind::Integer),
    Column("quantity", Kind::Text),
    Column("name", Kind::Text),
    Column("unit", Kind::Text),
    Column("value", Kind::Number),
    Column("std", Kind::Number),
    Column("ci95_low", Kind::Number),
    Column("ci95_high", Kind::Number),
    Column("determined", Kind::Integer),
    Column("at_bound", Kind::Integer),
    Column("verdict", Kind::Text),
    Column("began_utc", Kind::Text),
    Column("temperature_c", Kind::Number),
    Column("tank", Kind::Text),
    Column("mechanism", Kind::Text),
    Column("model_sha256", Kind::Text),
    Column("inputs_sha256", Kind::Text),
    Column("rig_version", Kind::Text),
];

/// Both tables, while they are written.
pub(crate) struct Table {
    csv: csv::Writer<Part>,
    parquet: Writer<Part>,
}

impl Table {
    pub(crate) fn begin(csv: Part, parquet: Part) -> Result<Self, Failure> {
        let mut csv = csv::Writer::from_writer(csv);
        csv.write_record(COLUMNS.iter().map(|Column(name, _)| name)).map_err(Failure::input)?;
        Ok(Self { csv, parquet: Writer::begin(parquet, &COLUMNS).map_err(Failure::input)? })
    }

    /// Adds what `task`, called `id`, says of `number`.
    pub(crate) fn add(
        &mut self,
        (id, task): (&str, &Task),
        subject: &Subject,
        verdict: Option<&str>,
        number: &Number,
    ) -> Result<(), Failure> {
        let resample = task.resample.as_ref();
        let flag = |flag: Option<bool>| Cell::integer(flag.map(i64::from));
        let seed = task.seed.map(i64::try_from).transpose().map_err(Failure::input)?;
        let conditions = &subject.conditions;
        let row: [Cell<'_>; COLUMNS.len()] = [
            Cell::text(Some(id)),
            Cell::text(Some(&task.experiment)),
            Cell::text(Some(&task.variation)),
            Cell::integer(seed),
            Cell::text(resample.map(|resample| match resample.by {
                By::Run => "run",
                By::Block => "block",
            })),
            Cell::integer(resample.map(|resample| i64::from(resample.number))),
            Cell::text(Some(number.quantity.name())),
            Cell::text(Some(&number.name)),
            Cell::text(Some(&number.unit)),
            Cell::number(Some(number.value)),
            Cell::number(number.std),
            Cell::number(number.ci95.map(|[low, _]| low)),
            Cell::number(number.ci95.map(|[_, high]| high)),
            flag(number.determined),
            flag(number.at_bound),
            Cell::text(verdict),
            Cell::text(conditions.began_utc.as_deref()),
            Cell::number(conditions.temperature_c),
            Cell::text(conditions.tank.as_deref()),
            Cell::text(conditions.mechanism.as_deref()),
            Cell::text(task.model_sha256.as_deref()),
            Cell::text(Some(&task.inputs_sha256)),
            Cell::text(Some(&task.version)),
        ];
        self.csv.write_record(row.iter().map(Cell::csv)).map_err(Failure::input)?;
        self.parquet.add(&row).map_err(Failure::input)
    }

    pub(crate) fn finish(self) -> Result<(), Failure> {
        let csv = self.csv.into_inner().map_err(|error| Failure::Input(anyhow!("{error}")))?;
        csv.finish().map_err(Failure::input)?;
        self.parquet.finish().map_err(Failure::input)?.finish().map_err(Failure::input)
    }
}
