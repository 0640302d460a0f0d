/* The C interface between Eigenhand and a compiled hand plugin.
 *
 * A plugin generates a hand: from options it generates the files of a hand's directory, the manifest among them. It is a
 * dynamic library (Linux or macOS) that exports one symbol,
 *
 *     const eigenhand_hand_plugin_t eigenhand_hand_plugin;
 *
 * Only integers, C functions, and pointers to bytes with a length cross the boundary. The plugin owns everything that it
 * returns, until `free`. The caller owns everything that it passes; it is valid during the call only. The table and the
 * functions stay valid and unchanged from the moment the library is opened. No function may unwind or longjmp out of
 * itself. The program calls one function at a time, even with several threads, and makes no call while another one runs.
 * It copies the files when it loads the hand: no code of a plugin runs in a simulation.
 *
 * This file declares the same types as the Rust crate eigenhand-hand-abi, whose tests compare the two.
 */
#ifndef EIGENHAND_HAND_H
#define EIGENHAND_HAND_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* First field of the table; it marks the symbol as a hand plugin. */
#define EIGENHAND_HAND_MAGIC 0x45484E44u
/* A plugin built for another major version is refused. */
#define EIGENHAND_HAND_ABI_MAJOR 1u
/* Grows when a function is appended; older plugins stay valid. */
#define EIGENHAND_HAND_ABI_MINOR 0u

/* Result of a function: EIGENHAND_HAND_OK, or any other number for a failure. */
typedef int32_t eigenhand_status;
/* The function succeeded. */
#define EIGENHAND_HAND_OK 0
/* The function failed; after `generate`, `error_message` gives the reason. */
#define EIGENHAND_HAND_ERROR 1
/* The function panicked or threw an exception, and the plugin caught it. */
#define EIGENHAND_HAND_PANIC 2

#define EIGENHAND_HAND_EXPORT __attribute__((visibility("default")))

/* Borrowed bytes. */
typedef struct eigenhand_bytes {
    const uint8_t *data; /* first byte; may be null where len is 0 */
    size_t len;          /* number of bytes */
} eigenhand_bytes;

typedef struct eigenhand_hand_plugin_t {
    /* The first four fields are equal in every version of the interface. */
    uint32_t magic;       /* EIGENHAND_HAND_MAGIC */
    uint32_t abi_major;   /* EIGENHAND_HAND_ABI_MAJOR */
    uint32_t abi_minor;   /* EIGENHAND_HAND_ABI_MINOR */
    uint32_t struct_size; /* sizeof(eigenhand_hand_plugin_t): how many functions the plugin has */

    /* Generates a hand.
     *
     * options: options_len bytes of UTF-8, the table [options] of the plugin's sidecar as TOML, or no bytes if the sidecar
     * has no options. The caller owns them; they are valid during the call and not terminated by a zero byte.
     * out: holds null before the call. The plugin writes a pointer to it, also when it fails, so that the caller can ask
     * `error_message`; the caller passes the pointer to `free` once. After a failure without a reason the plugin may leave
     * null there. Only the plugin knows the type behind the pointer. */
    eigenhand_status (*generate)(const uint8_t *options, size_t options_len, void **out);

    /* Writes the number of the hand's files to *out.
     *
     * hand: from a `generate` that succeeded, and `free` was not called with it. */
    eigenhand_status (*file_count)(const void *hand, size_t *out);

    /* Points *name and *content at the name and the content of a file.
     *
     * index: smaller than the number of files.
     * name: a path below the hand's directory, in UTF-8, with `/` between its parts.
     * The plugin owns both; they are valid and unchanged until free(hand). */
    eigenhand_status (*file)(const void *hand, size_t index, eigenhand_bytes *name, eigenhand_bytes *content);

    /* Points *out at the reason for a failure.
     *
     * hand: from a `generate` that failed. The message is UTF-8. The plugin owns it; it is valid and unchanged until
     * free(hand). */
    eigenhand_status (*error_message)(const void *hand, eigenhand_bytes *out);

    /* Frees the result of `generate` with all its bytes. Null is allowed and does nothing. */
    void (*free)(void *hand);
} eigenhand_hand_plugin_t;

/* The one symbol that a plugin exports. */
extern EIGENHAND_HAND_EXPORT const eigenhand_hand_plugin_t eigenhand_hand_plugin;

#ifdef __cplusplus
}
#endif

#endif
