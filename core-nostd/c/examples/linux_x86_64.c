/* Runs the pipeline without a C library: t0 and t1 (8 bytes each), then EVT3 words from standard input; the tensors to
 * standard output. */
#include "pipeline.h"

static long syscall3(long number, long a, const void *b, long c) {
    long result;
    __asm__ volatile("syscall" : "=a"(result) : "a"(number), "D"(a), "S"(b), "d"(c) : "rcx", "r11", "memory");
    return result;
}

enum { READ = 0, WRITE = 1, EXIT = 60 };

static struct tensors out;

static void write_all(const uint8_t *bytes, size_t len) {
    while (len > 0) {
        long n = syscall3(WRITE, 1, bytes, (long)len);
        if (n <= 0) syscall3(EXIT, 9, NULL, 0);
        bytes += n;
        len -= (size_t)n;
    }
}

static size_t read_some(uint8_t *bytes, size_t room) {
    long n = syscall3(READ, 0, bytes, (long)room);
    return n > 0 ? (size_t)n : 0;
}

void run(void);
void run(void) {
    uint64_t window[2];
    uint8_t packet[1000];
    size_t len = 0;
    while (len < sizeof window) {
        size_t n = read_some((uint8_t *)window + len, sizeof window - len);
        if (n == 0) syscall3(EXIT, 8, NULL, 0);
        len += n;
    }
    lobula_status status = pipeline_start(&out, window[0], window[1]);
    while (status == LOBULA_OK && (len = read_some(packet, sizeof packet)) > 0) {
        status = pipeline_packet(&out, packet, len);
    }
    pipeline_finish(&out);
    write_all((const uint8_t *)&out, sizeof out);
    syscall3(EXIT, (long)status, NULL, 0);
}

__asm__(".globl _start\n_start: xor %ebp, %ebp\n and $-16, %rsp\n call run\n hlt\n");
