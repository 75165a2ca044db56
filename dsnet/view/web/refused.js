// A file that this page does not read is refused in a line.
export const BY_PYTHON = "dsnet view --motion FILE";
export function refuse(flaw) { throw new Error(flaw); }
