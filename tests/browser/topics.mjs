// Receives the topics of a flight by the published client of the Foxglove protocol, and compares them with the flight's log.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import foxglove from "@foxglove/ws-protocol";
import { McapStreamReader } from "@mcap/core";
import { WebSocket } from "ws";

const { FoxgloveClient } = foxglove;

/** Time for which samples are received, ms. */
const LISTENING = 3000;

/** The protocol's other name, which the published client does not know yet. */
const NEW_NAME = "foxglove.sdk.v1";

const inWebSocket = (address) => address.replace(/^http/, "ws");

/** Opens a WebSocket by a protocol, from the page of a site: the protocol that was agreed upon, or the status of a refusal. */
export function knock(address, protocol, origin) {
  return new Promise((done) => {
    const socket = new WebSocket(inWebSocket(address), [protocol], { origin });
    socket.on("open", () => {
      done(socket.protocol);
      socket.close();
    });
    socket.on("unexpected-response", (_, response) => {
      done(response.statusCode);
      socket.terminate();
    });
    socket.on("error", () => {});
  });
}

/** Checks the names of the protocol and who may use it. */
export async function checkDoor(address) {
  assert.equal(await knock(address, NEW_NAME), NEW_NAME);
  assert.equal(await knock(address, "x.v1"), 400);
  assert.equal(await knock(address, NEW_NAME, "https://evil.example"), 403);
}

/** Receives all topics for a while: the channels, the samples of each by time, and what the server can do. */
export function receive(address) {
  return new Promise((done, failed) => {
    const channels = new Map();
    const topicOf = new Map();
    const samples = [];
    let info = null;
    const client = new FoxgloveClient({ ws: new WebSocket(inWebSocket(address), [FoxgloveClient.SUPPORTED_SUBPROTOCOL]) });
    client.on("error", failed);
    client.on("serverInfo", (event) => { info = event; });
    client.on("advertise", (news) => {
      for (const channel of news) {
        channels.set(channel.topic, channel);
        topicOf.set(client.subscribe(channel.id), channel.topic);
      }
      // What the server does not offer it does not hear.
      client.setParameters([{ name: "controller.k1", value: 0 }], "1");
      const own = client.advertise("control/command", "cdr", "gerono_msgs/msg/ControlCommand");
      client.sendMessage(own, new Uint8Array(64));
    });
    client.on("parameterValues", () => failed(new Error("it has answered a change of parameters")));
    client.on("message", ({ subscriptionId, timestamp, data }) => {
      samples.push({ topic: topicOf.get(subscriptionId), time: timestamp, data: Buffer.from(data.buffer, data.byteOffset, data.byteLength) });
    });
    setTimeout(() => {
      client.close();
      done({ info, channels, samples });
    }, LISTENING);
  });
}

/** Compares what was received with a log: every sample is in it, byte for byte, under the same schema. */
export function compare({ info, channels, samples }, log) {
  assert.deepEqual(info.capabilities, []);
  const reader = new McapStreamReader();
  reader.append(readFileSync(log));
  const schemas = new Map();
  const logged = new Map();
  const messages = new Map();
  for (let record = reader.nextRecord(); record !== undefined; record = reader.nextRecord()) {
    if (record.type === "Schema") schemas.set(record.id, record);
    if (record.type === "Channel") logged.set(record.id, record);
    if (record.type === "Message") messages.set(`${logged.get(record.channelId).topic} ${record.logTime}`, record);
  }
  for (const { topic, messageEncoding, schemaId } of logged.values()) {
    const channel = channels.get(topic);
    if (channel === undefined) continue;
    const schema = schemas.get(schemaId);
    assert.deepEqual([channel.encoding, channel.schemaName, channel.schemaEncoding], [messageEncoding, schema.name, schema.encoding]);
    assert.equal(channel.schema, new TextDecoder().decode(schema.data));
  }
  const readers = new Map([...channels].map(([topic, { schema }]) => [topic, new MessageReader(parse(schema, { ros2: true }))]));
  for (const { topic, time, data } of samples) {
    const message = messages.get(`${topic} ${time}`);
    assert.ok(message !== undefined, `${topic} at ${time} ns is not in the log`);
    assert.ok(data.equals(Buffer.from(message.data)), `${topic} at ${time} ns`);
    const { header } = readers.get(topic).readMessage(data);
    assert.equal(Number(header.seq), message.sequence);
  }
  return { topics: channels.size, samples: samples.length };
}
