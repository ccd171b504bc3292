// Prints as JSON what @mcap/core finds in a file, by its index and by a stream.
import { readFile } from "node:fs/promises";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { decompress } from "fzstd";

const content = new Uint8Array(await readFile(process.argv[2]));
const decompressHandlers = { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) };
const readable = {
  size: async () => BigInt(content.byteLength),
  read: async (offset, size) => content.subarray(Number(offset), Number(offset + size)),
};

const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
const decoders = new Map();
const rows = [];
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  if (!decoders.has(channel.id)) {
    const schema = reader.schemasById.get(channel.schemaId);
    const text = new TextDecoder().decode(schema.data);
    decoders.set(channel.id, new MessageReader(parse(text, { ros2: true })));
  }
  const decoded = decoders.get(channel.id).readMessage(message.data);
  const { header, ...values } = decoded;
  rows.push([message.logTime.toString(), message.sequence, header.stamp.sec, header.stamp.nanosec, values]);
}

const metadata = {};
for await (const record of reader.readMetadata()) {
  metadata[record.name] = Object.fromEntries(record.metadata);
}
const attachments = {};
for await (const record of reader.readAttachments()) {
  attachments[record.name] = Buffer.from(record.data).toString("base64");
}

const stream = new McapStreamReader({ decompressHandlers, validateCrcs: true });
stream.append(content);
const kinds = {};
for (let record; (record = stream.nextRecord()); ) {
  kinds[record.type] = (kinds[record.type] ?? 0) + 1;
}
console.log(JSON.stringify({
  profile: reader.header.profile,
  messages: Number(reader.statistics.messageCount),
  done: stream.done(),
  kinds,
  metadata,
  attachments,
  rows,
}));
