// Recordings of the robot: start and stop, and those that are there, to be taken along.

import { useEffect } from "preact/hooks";
import { signal } from "@preact/signals";

import { mayDrive } from "../driving/driving";
import { now } from "../robot/clock";
import { topics } from "../robot/robot";
import { ask } from "../wire/live";
import type { RecordedFile, RecorderState, RecordingList } from "../wire/messages";
import { decode } from "../wire/msgpack";
import { size } from "../sizes";
import { words } from "../words";

const text = words.recordings;
const REFRESH_MS = 3000;
const SILENT_MS = 5000;
const WHEN = { dateStyle: "short", timeStyle: "short" } as const;

interface Listed {
  readonly files: readonly RecordedFile[];
  /** Why there is no list; empty: there is. */
  readonly trouble: string;
}

const listed = signal<Listed | null>(null);

export function Recordings() {
  const state = topics.RecorderState.newest.value;
  useEffect(() => {
    void refresh();
    const timer = setInterval(() => void refresh(), REFRESH_MS);
    return () => clearInterval(timer);
  }, [state?.is_recording]);
  return (
    <div class="recordings">
      <Recorder state={state} />
      {listed.value !== null && listed.value.trouble !== "" && <p role="alert">{listed.value.trouble}</p>}
      <Files files={listed.value?.files ?? []} />
    </div>
  );
}

function Recorder({ state }: { readonly state: RecorderState | null }) {
  if (state === null) return <p class="empty">{text.unheard}</p>;
  const isSilent = topics.RecorderState.ageMs(now.value) > SILENT_MS;
  if (state.folder === "") return <p class="empty">{text.noFolder}</p>;
  const isRecording = state.is_recording;
  return (
    <>
      <div class="row">
        <button
          type="button"
          class={isRecording ? "" : "primary"}
          disabled={!mayDrive.value || isSilent}
          onClick={() => ask(isRecording ? text.stop : text.start, { type: "RecordRequest", on: !isRecording })}
        >
          {isRecording ? text.stop : text.start}
        </button>
        <p role="status">
          {isSilent ? text.silent : isRecording && state.trouble === "" ? text.records : text.off(isRecording)}
          {state.free_bytes !== null && ` ${text.free(size(state.free_bytes))}`}
        </p>
      </div>
      {state.trouble !== "" && (
        <p class="trouble" role="alert">
          {state.trouble}
        </p>
      )}
    </>
  );
}

function Files({ files }: { readonly files: readonly RecordedFile[] }) {
  const runs = files.filter(({ name }) => name.endsWith(".mcap"));
  const others = files.filter(({ name }) => !name.endsWith(".mcap"));
  return (
    <>
      {runs.length === 0 ? <p class="empty">{text.none}</p> : <Table files={runs} name={text.name} />}
      {runs.length > 0 && <p class="hint">{text.replay}</p>}
      {others.length > 0 && (
        <details>
          <summary>{text.others(others.length)}</summary>
          <Table files={others} name={text.othersName} />
        </details>
      )}
    </>
  );
}

function Table({ files, name }: { readonly files: readonly RecordedFile[]; readonly name: string }) {
  return (
    <table aria-label={name}>
      <tbody>
        {files.map((file) => (
          <tr key={file.name}>
            <th scope="row">
              <a href={`/recordings/${file.name}`} download={file.name}>
                {file.name}
              </a>
            </th>
            <td>{new Date(1000 * (file.begin_s ?? file.modified_s)).toLocaleString([], WHEN)}</td>
            <td>
              {file.begin_s !== null && file.end_s !== null && words.replay.clock(file.end_s - file.begin_s)}
              {file.is_written && text.written}
            </td>
            <td>{size(file.size)}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

async function refresh(): Promise<void> {
  try {
    const answer = await fetch("/recordings");
    if (!answer.ok) listed.value = { files: [], trouble: await answer.text() };
    else {
      const { files } = decode(new Uint8Array(await answer.arrayBuffer())) as RecordingList;
      listed.value = { files, trouble: "" };
    }
  } catch {
    // The connection is lost: the page says so already, and the list stays.
  }
}
