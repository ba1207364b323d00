// SPDX-FileCopyrightText: The kitti_ros2 authors
// SPDX-License-Identifier: Apache-2.0
//
// Prints the messages of an MCAP file or a ROS 1 bag as @mcap/core and @foxglove/rosbag decode them:
// a line of JSON each, [topic, stamp in nanoseconds, message]. Bytes are their SHA-256.

const { createHash } = require("crypto");
const { open } = require("fs/promises");

function plain(value) {
  if (value instanceof Uint8Array) {
    return createHash("sha256").update(value).digest("hex");
  }
  if (Array.isArray(value) || ArrayBuffer.isView(value)) {
    return Array.from(value, plain);
  }
  if (typeof value === "bigint" || (typeof value === "number" && !Number.isFinite(value))) {
    return String(value);
  }
  if (value === null || typeof value !== "object") {
    return value;
  }
  return Object.fromEntries(Object.entries(value).map(([name, part]) => [name, plain(part)]));
}

function print(topic, stamp, message) {
  process.stdout.write(`${JSON.stringify([topic, String(stamp), plain(message)])}\n`);
}

async function readMcap(path) {
  const { McapIndexedReader } = require("@mcap/core");
  const { FileHandleReadable } = require("@mcap/nodejs");
  const { parse } = require("@foxglove/rosmsg");
  const { MessageReader } = require("@foxglove/rosmsg2-serialization");
  const decompressHandlers = {
    lz4: (data) => require("lz4js").decompress(data),
    zstd: (data) => require("fzstd").decompress(data),
  };
  const readable = new FileHandleReadable(await open(path));
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const decoders = new Map();
  for await (const message of reader.readMessages()) {
    const { topic, schemaId } = reader.channelsById.get(message.channelId);
    if (!decoders.has(schemaId)) {
      const text = new TextDecoder().decode(reader.schemasById.get(schemaId).data);
      decoders.set(schemaId, new MessageReader(parse(text, { ros2: true })));
    }
    print(topic, message.logTime, decoders.get(schemaId).readMessage(message.data));
  }
}

async function readRos1(path) {
  const { Bag } = require("@foxglove/rosbag");
  const { FileReader } = require("@foxglove/rosbag/node");
  const decompress = { lz4: (data) => require("lz4js").decompress(data) };
  const bag = new Bag(new FileReader(path), { decompress });
  await bag.open();
  for await (const { topic, timestamp, message } of bag.messageIterator()) {
    print(topic, BigInt(timestamp.sec) * 1_000_000_000n + BigInt(timestamp.nsec), message);
  }
}

const path = process.argv[2];
(path.endsWith(".bag") ? readRos1 : readMcap)(path);
