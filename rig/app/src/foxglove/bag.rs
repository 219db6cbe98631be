//! The file that is written: its topics, a channel each.

use std::collections::BTreeMap;
use std::io::BufWriter;

use anyhow::Context as _;
use mcap::records::MessageHeader;
use serde_json::Value;

use interchange::foxglove::schemas::Schema;
use record::files::Part;

pub(super) const IMAGE: &str = "/camera/image";
pub(super) const ANNOTATIONS: &str = "/camera/annotations";
pub(super) const CALIBRATION: &str = "/camera/calibration";
pub(super) const FRAMES: &str = "/frames";
pub(super) const CAMERA_FRAME: &str = "/camera/frame";
pub(super) const MEASURED: &str = "/measured";
pub(super) const SIMULATED: &str = "/simulated";
pub(super) const KEYPOINTS: &str = "/keypoints";
pub(super) const SERVO: &str = "/servo";
pub(super) const TELEMETRY: &str = "/servo/telemetry";
pub(super) const JOURNAL: &str = "/journal";

/// An MCAP file of JSON messages, its channels made as they are needed.
pub(super) struct Bag {
    mcap: mcap::Writer<BufWriter<Part>>,
    channels: BTreeMap<&'static str, u16>,
    /// Sequence number of the last message.
    sequence: u32,
}

impl Bag {
    pub(super) fn new(file: Part) -> anyhow::Result<Self> {
        let options = mcap::WriteOptions::new()
            .compression(Some(mcap::Compression::Zstd))
            .library(concat!("rig ", env!("CARGO_PKG_VERSION")));
        Ok(Self { mcap: options.create(BufWriter::new(file))?, channels: BTreeMap::new(), sequence: 0 })
    }

    pub(super) fn open(&mut self, topic: &'static str, schema: &Schema) -> anyhow::Result<()> {
        let id = self.mcap.add_schema(schema.name, "jsonschema", &serde_json::to_vec(&schema.text)?)?;
        let channel = self.mcap.add_channel(id, topic, "json", &BTreeMap::new())?;
        self.channels.insert(topic, channel);
        Ok(())
    }

    pub(super) fn write(&mut self, topic: &str, at_ns: u64, message: &Value) -> anyhow::Result<()> {
        let channel_id = *self.channels.get(topic).context("a topic that was not opened")?;
        self.sequence += 1;
        let header =
            MessageHeader { channel_id, sequence: self.sequence, log_time: at_ns, publish_time: at_ns };
        Ok(self.mcap.write_to_known_channel(&header, &serde_json::to_vec(message)?)?)
    }

    pub(super) fn finish(mut self) -> anyhow::Result<()> {
        self.mcap.finish()?;
        let file = self.mcap.into_inner().into_inner().map_err(|error| error.into_error())?;
        Ok(file.finish()?)
    }
}
